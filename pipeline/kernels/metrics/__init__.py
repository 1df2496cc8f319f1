"""Distances between surfaces and point clouds, and statistics over objects."""

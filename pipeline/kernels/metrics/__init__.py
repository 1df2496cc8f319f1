"""Distances between surfaces, and statistics over objects."""

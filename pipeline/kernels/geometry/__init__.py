"""Meshes and points on them."""

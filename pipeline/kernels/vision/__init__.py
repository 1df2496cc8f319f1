"""Cameras, scenes and images."""

"""Cameras, scenes, and meshes prepared for rendering."""

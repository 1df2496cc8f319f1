"""Trained networks: save, load, apply."""

"""Reconstruct from one's own files, or from a stored grasp."""

"""Photographs of a gel: read them, and train a network for one's own sensor."""

"""The one way to read a dataset: rows of objects, for stages, training and users."""

"""Datasets as what makes them: write, remake, compare."""

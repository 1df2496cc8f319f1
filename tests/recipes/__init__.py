"""Tests of `pipeline/recipes`."""

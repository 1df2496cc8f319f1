"""Tests of `pipeline/contrib`."""

"""Tests of `pipeline/drawing`."""

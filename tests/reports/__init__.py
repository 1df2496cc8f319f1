"""Tests of `pipeline/reports`."""

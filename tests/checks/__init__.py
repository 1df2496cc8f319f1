"""Tests of `pipeline/checks`."""

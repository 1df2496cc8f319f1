"""Tests of `pipeline/reconstruct`."""

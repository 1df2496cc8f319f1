"""Tests of `pipeline/contrib/exports`."""

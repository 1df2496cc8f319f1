"""Tests of `pipeline/contrib/report`."""

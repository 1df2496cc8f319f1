"""Tests of `pipeline/contrib/toy_objects`."""

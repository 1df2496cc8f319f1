"""Tests of `pipeline/real_touch`."""

"""Tests of `pipeline/contrib/calibration`."""

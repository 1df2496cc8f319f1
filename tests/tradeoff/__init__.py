"""Tests of `pipeline/tradeoff`."""

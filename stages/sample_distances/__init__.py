"""The stage `sample-distances`."""

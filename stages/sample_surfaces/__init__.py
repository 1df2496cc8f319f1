"""The stage `sample-surfaces`."""

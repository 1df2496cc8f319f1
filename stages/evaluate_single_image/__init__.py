"""The stage `evaluate-single-image`."""

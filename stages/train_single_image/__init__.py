"""The stage `train-single-image`."""

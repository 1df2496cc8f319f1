"""The stage `train-implicit`."""

"""The stage `fit-charts`."""

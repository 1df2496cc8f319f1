"""Measurements: each module prints one stage's figures beside their raw limits; `make bench` runs them all."""

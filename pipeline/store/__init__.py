"""Zarr shards: how they are laid out, written, checked and read."""

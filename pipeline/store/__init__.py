"""Artifacts on a disk: shards, records, checks."""

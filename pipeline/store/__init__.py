"""Stored artifacts: shards, records, checks."""

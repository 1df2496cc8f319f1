"""What every stage writes: one module an artifact, declarations only."""

"""From an observation to a mesh."""

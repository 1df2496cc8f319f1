"""Pure functions on arrays: they import nothing of ours but one another."""

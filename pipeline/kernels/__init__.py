"""Arithmetic on arrays, and the types it works on: it opens no file, and imports nothing of stages, storage or commands."""

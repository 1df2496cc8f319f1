"""Slow, readable twins of the kernels, in other formulations; nothing here imports the code under test."""

"""Depth read from photographs of real sensors, beside known shapes: `make bench-touch REAL=FOLDER`."""

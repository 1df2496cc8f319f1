"""Simulated touch: sensors, depth by ray and sphere tracing, readings, contact."""

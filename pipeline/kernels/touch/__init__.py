"""Simulated touch: sensors, depth by ray and sphere tracing, tactile images, contact."""

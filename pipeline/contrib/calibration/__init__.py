"""Calibrate a sensor description from photographs."""

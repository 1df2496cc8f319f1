"""Prediction from files or stored grasps, and calibration of sensors."""

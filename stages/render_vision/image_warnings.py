"""Warnings of objects that do not fit an image."""

import numpy as np

from pipeline.kernels.vision.camera import Camera, project_points, projection_matrix

SPECK = 0.1
"""Share of an image's side below which an object has too few pixels: 25 of 256."""


def leaves_image(camera: Camera, points: np.ndarray) -> bool:
    """Check whether any of the points (N, 3), world frame, m, is outside a camera's image."""
    rows, cols = camera.shape
    places = project_points(projection_matrix(camera), points.astype(np.float64))
    return not bool(((places >= 0) & (places <= [cols, rows])).all())  # NaN behind the camera is not


def is_speck(camera: Camera, points: np.ndarray) -> bool:
    """Check whether points (N, 3), world frame, m, span less than `SPECK` of a camera's image both ways."""
    rows, cols = camera.shape
    spans = np.ptp(project_points(projection_matrix(camera), points.astype(np.float64)), axis=0)
    return bool((spans < [SPECK * cols, SPECK * rows]).all())

"""Warnings of objects that do not fit an image."""

from __future__ import annotations

import numpy as np

from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.vision.camera import Camera, project_points, projection_matrix

SPECK = 0.1
"""Share of an image's side below which an object has too few pixels: 25 of 256."""


FILLED = 0.72
"""Radius of the ball around an object of 0.5 m in the supplement's scene, as a share of the distance from the middle to the edge."""
WORTHWHILE = 2.0
"""A zoom that enlarges objects by at least this factor is proposed."""


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


def largest_zoom(camera: Camera, points: np.ndarray) -> float:
    """Compute the largest factor of the focal lengths with which the ball around an object stays within a camera's image.

    Parameters
    ----------
    camera
        Gives the pose and the focal lengths that are multiplied.
    points
        (N, 3) of the object, world frame, m. The ball has the middle and the diagonal of their bounding box.

    Returns
    -------
    The factor, below 1 if the ball leaves the image, 0 if some of it is behind the camera.
    """
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    ends = np.concatenate([np.eye(3), -np.eye(3)]) * length(high - low) / 2
    places = project_points(projection_matrix(camera), (low + high) / 2 + ends) - camera.centre
    rows, cols = camera.shape
    room = np.where(places > 0, np.array([cols, rows]) - camera.centre, camera.centre)
    with np.errstate(divide="ignore"):
        return float(np.nan_to_num(room / np.abs(places), nan=0.0, posinf=np.inf).min())

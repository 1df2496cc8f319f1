"""A sphere and cameras that look at it."""

import numpy as np

from pipeline.kernels.geometry.transforms import unit_vectors
from pipeline.kernels.vision.camera import Camera, look_at, projection_matrix

CENTRE = np.array([0.0, 0.0, 0.6])
RADIUS = 0.05


def camera_at(distance: float, pixels: float = 100.0) -> np.ndarray:
    """Look along -x at the centre, on which a length of the radius is `pixels` long."""
    focal = pixels * distance / RADIUS
    camera = Camera(name="camera", position=(1, 0, 0), rotation=(0, 0, 0), focal=(focal, focal), centre=(128, 128), resolution=256)
    return projection_matrix(look_at(camera, (distance, 0.0, 0.6), (0.0, 0.0, 0.6)))


def sphere_points(count: int = 5000) -> np.ndarray:
    return CENTRE + RADIUS * unit_vectors(np.random.default_rng(0).normal(size=(count, 3)))

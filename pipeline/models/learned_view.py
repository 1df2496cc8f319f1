"""Compare a camera with that of a network's training; no training depends on it."""

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import camera_direction, carried_camera
from pipeline.models.reconstruction import Reconstructor

DEGREES, SHARE = 1.0, 0.01
"""Largest differences of a camera from the training's that count as none: of its direction, and of pixels as a share of the image."""


def has_learned_view(
    model: Reconstructor,  # one without a camera has learned no view
    camera: NDArray[np.float64],  # (3, 4) projection matrix, of an object of the size that networks see
) -> bool:
    """Check whether a camera sees an object from the same side as the training's camera did, and as large."""
    if model.camera is None or model.resolution is None:
        return False
    centre = np.array(model.config.centre)
    corners = centre + model.config.radius * (np.indices((2, 2, 2)).reshape(3, -1).T * 2.0 - 1) / np.sqrt(3)
    own, trained = (camera_direction(matrix, centre) for matrix in (camera, model.camera))
    turns = np.degrees([own.azimuth - trained.azimuth, own.elevation - trained.elevation])
    seen, expected = (project_points(matrix, corners) for matrix in (camera, carried_camera(model.camera, camera, centre)))
    is_same_side = np.abs((turns + 180) % 360 - 180).max() <= DEGREES
    return bool(is_same_side and np.abs(seen - expected).max() <= SHARE * max(model.resolution))

"""Positions of pixels and rays, and checks of poses."""

import numpy as np
import pytest

from pipeline.kernels.touch.sensor import pixel_centres
from tests.kernels.touch.shapes import SENSOR, pose_at, ray_origins


def test_pixel_centres_and_ray_origins() -> None:
    x, y = pixel_centres(SENSOR)
    assert x[0] == pytest.approx((0.5 / 100 - 0.5) * 0.01641)
    assert y[99] == pytest.approx((99.5 / 100 - 0.5) * 0.01641)
    pose = pose_at(np.array([1.0, 2, 3]), np.array([0.3, -0.2, 0.9]), 0.01, 0.7)
    origins = ray_origins(pose, SENSOR)
    assert origins.shape == (100, 100, 3)
    assert np.allclose(origins[10, 20], pose[:3] @ [x[20], y[10], 0, 1], atol=1e-15)

"""Positions of pixels and rays, and checks of poses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from pipeline.kernels.touch.sensor import check_pose, pixel_centres
from tests.kernels.touch.shapes import (
    SENSOR,
    coarse,
    pose_at,
    ray_origins,
)
from tests.strategies import EPS, offsets, random_rotation, seeds

SMALL = coarse(6)
X, Y = pixel_centres(SMALL)


def test_pixel_centres_and_ray_origins() -> None:
    x, y = pixel_centres(SENSOR)
    assert x[0] == pytest.approx((0.5 / 100 - 0.5) * 0.01641)
    assert y[99] == pytest.approx((99.5 / 100 - 0.5) * 0.01641)
    pose = pose_at(np.array([1.0, 2, 3]), np.array([0.3, -0.2, 0.9]), 0.01, 0.7)
    origins = ray_origins(pose, SENSOR)
    assert origins.shape == (100, 100, 3)
    assert np.allclose(origins[10, 20], pose[:3] @ [x[20], y[10], 0, 1], atol=1e-15)


@given(seed=seeds, offset=offsets)
def test_ray_origins_lie_on_the_sensor_plane(seed, offset) -> None:
    pose = pose_at(offset, random_rotation(np.random.default_rng(seed))[0], 0.01, seed % 6)
    local = (ray_origins(pose, SMALL) - pose[:3, 3]) @ pose[:3, :3]
    expected = np.stack(np.broadcast_arrays(X[None, :], Y[:, None], 0.0), axis=-1)
    assert np.abs(local - expected).max() <= 4 * EPS * (np.abs(offset).max() + 1)


@pytest.mark.parametrize("spoil", ["transposed", "projective"])
def test_pose_with_another_last_row_is_refused(spoil) -> None:
    pose = pose_at(np.array([0.1, 0.2, 0.3]), np.array([0, 0, 1.0]), 0.01)
    bad = pose.T if spoil == "transposed" else pose + np.diag([0, 0, 0, 1.0])
    with pytest.raises(ValueError, match="last row"):
        check_pose(bad)

"""Face culling keeps every face that a ray can hit, and few others."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.kernels.touch.ray_depth import box_faces, cull_faces, ray_depth
from tests.kernels.touch.shapes import (
    SENSOR,
    ball,
    coarse,
    pose_at,
    ray_origins,
)
from tests.references.brute_force_depth import brute_force


def test_culling_drops_faces_that_no_ray_hits_and_keeps_the_rest() -> None:
    triangles = ball(6, 0.25)
    faces = box_faces(triangles)
    pose = pose_at(np.array([0.25, 0, 0]), np.array([-1.0, 0, 0]), 0.005)
    kept = cull_faces(faces, pose, SENSOR)
    assert 0 < kept.shape[2] < 0.01 * len(triangles)
    away = pose_at(np.array([0.25, 0, 0]), np.array([1.0, 0, 0]), -0.001)
    assert cull_faces(faces, away, SENSOR).shape == (3, 3, 0)
    truth = brute_force(triangles, ray_origins(pose, coarse(6)), pose[:3, 2], SENSOR.range)
    assert np.abs(ray_depth(faces, pose, coarse(6)) - truth.depth).max() <= 1e-8


@pytest.mark.parametrize(
    ("triangles", "message"),
    [(np.zeros((4, 3)), r"shape \(4, 3\)"), (np.full((1, 3, 3), np.nan), "NaN")],
)
def test_invalid_triangles_are_refused(triangles: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        box_faces(triangles)

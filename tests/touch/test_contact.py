"""The touch rule and the local points."""

import numpy as np
import pytest

from pipeline.kernels.touch.contact import local_points, touch_success
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import ray_origins
from tests.touch.scenes import SENSOR, pybullet_triangles, random_pose


def test_rule() -> None:
    nearest = np.array([0.0, 1e-6, 0.0066, 0.006699, 0.006701, 0.0068, np.inf])
    depth = np.full((7, 4, 4), np.inf)
    depth[:, 2, 1] = nearest
    assert touch_success(depth, SENSOR).tolist() == [False, True, True, True, False, False, False]
    assert touch_success(depth[1], SENSOR).shape == ()


def test_points_are_those_in_the_gel_in_order_and_exact() -> None:
    triangles = pybullet_triangles("duck.obj")
    pose = random_pose(triangles, np.random.default_rng(9))
    exact = ray_depth(box_faces(triangles), pose, SENSOR)
    depth = exact.astype(np.float32)
    points, count = local_points(depth, pose, SENSOR)
    assert points.shape == (10_000, 3)
    assert points.dtype == np.float32
    assert count == (depth < SENSOR.w).sum() > 0
    assert (points[count:] == 0).all()
    expected = (ray_origins(pose, SENSOR) + np.where(np.isfinite(exact), exact, 0)[..., None] * pose[:3, 2])[depth < SENSOR.w]
    assert np.abs(points[:count] - expected).max() <= 1e-7


def test_points_are_the_same_to_the_bit_when_had_again() -> None:
    rng = np.random.default_rng(10)
    triangles = pybullet_triangles("objects/mug.obj")
    for _ in range(5):
        pose = random_pose(triangles, rng)
        depth = ray_depth(box_faces(triangles), pose, SENSOR).astype(np.float32)
        first, again = local_points(depth, pose, SENSOR), local_points(depth.copy(order="F"), pose.copy(), SENSOR)
        assert first[0].tobytes() == again[0].tobytes()
        assert first[1] == again[1]


def test_points_need_the_stored_depth() -> None:
    with pytest.raises(ValueError, match="float32"):
        local_points(np.zeros(SENSOR.shape), np.eye(4), SENSOR)

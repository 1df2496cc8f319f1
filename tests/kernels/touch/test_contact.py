"""Success of touches, and local points."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.touch.depth_maps import CONTACT_MARGIN, local_points, touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.sensor import pixel_centres
from tests.kernels.touch.shapes import (
    SENSOR,
    ball,
    coarse,
    one_pixel,
    pose_at,
    pybullet_triangles,
    random_pose,
    ray_origins,
)
from tests.strategies import offsets, random_rotation, seeds

SMALL = coarse(8)


def test_touch_success_requires_depth_below_gel_minus_margin() -> None:
    nearest = np.array([0.0, 1e-6, 0.0066, 0.006699, 0.006701, 0.0068, np.inf])
    depth = np.full((7, 4, 4), np.inf)
    depth[:, 2, 1] = nearest
    assert touch_success(depth, SENSOR).tolist() == [False, True, True, True, False, False, False]
    assert touch_success(depth[1], SENSOR).shape == ()


@given(nearest=st.floats(0, 0.01))
def test_touch_success_is_judged_in_float32(nearest) -> None:
    floor = np.array([[[-1, -1, nearest], [3, -1, nearest], [-1, 3, nearest]]])
    judged = float(np.float32(nearest))
    expected = 0 < judged < SENSOR.w - CONTACT_MARGIN
    assert touch_success(ray_depth(box_faces(floor), np.eye(4), SENSOR), SENSOR) == expected
    assert touch_success(np.full(SENSOR.shape, nearest), SENSOR) == expected
    assert touch_success(np.full(SENSOR.shape, np.float32(nearest)), SENSOR) == expected


def test_touch_success_of_no_sensors_is_empty() -> None:
    assert touch_success(np.zeros((0, 4, 8, 8)), SMALL).shape == (0, 4)


def test_local_points_are_those_in_the_gel_in_order() -> None:
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


def test_local_points_depend_on_values_alone() -> None:
    rng = np.random.default_rng(10)
    triangles = pybullet_triangles("objects/mug.obj")
    for _ in range(5):
        pose = random_pose(triangles, rng)
        depth = ray_depth(box_faces(triangles), pose, SENSOR).astype(np.float32)
        first, again = local_points(depth, pose, SENSOR), local_points(depth.copy(order="F"), pose.copy(), SENSOR)
        assert first[0].tobytes() == again[0].tobytes()
        assert first[1] == again[1]


def test_local_points_need_float32_depth() -> None:
    with pytest.raises(ValueError, match="float32"):
        local_points(np.zeros(SENSOR.shape), np.eye(4), SENSOR)


def test_one_pixel_in_the_gel_is_one_point() -> None:
    points, count = local_points(one_pixel(0.003, SMALL).astype(np.float32), np.eye(4), SMALL)
    x, y = pixel_centres(SMALL)
    assert count == 1
    np.testing.assert_array_equal(points[0], np.float32([x[5], y[3], np.float32(0.003)]))


def test_surface_in_front_of_the_whole_gel() -> None:
    """A ball of 1 m radius, from outside and with the sensor inside."""
    at = pose_at(np.array([0, 0, -1.0]), np.array([0, 0, 1.0]), SENSOR.w - 0.003)
    depth = ray_depth(box_faces(ball(5, 1.0)), at, SENSOR)
    assert (depth < SENSOR.w).all()
    assert local_points(depth.astype(np.float32), at, SENSOR)[1] == 10_000
    assert np.isinf(ray_depth(box_faces(ball(5, 1.0)), np.eye(4), SENSOR)).all()


@given(seed=seeds, offset=offsets)
def test_local_points_are_accurate_to_half_a_float32_unit(seed, offset) -> None:
    """Compare with rigid motion in rational arithmetic."""
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = random_rotation(rng), offset
    depth = rng.uniform(0, 0.01, SMALL.shape).astype(np.float32)
    points, count = local_points(depth, pose, SMALL)
    row, col = np.nonzero(depth.astype(np.float64) < SMALL.w)
    x, y = pixel_centres(SMALL)
    assert count == len(row)
    for k in rng.integers(0, count, 5):
        local = [Fraction(float(v)) for v in (x[col[k]], y[row[k]], depth[row[k], col[k]])]
        for axis in range(3):
            exact = sum((Fraction(float(a)) * b for a, b in zip(pose[axis, :3], local, strict=True)), Fraction(float(offset[axis])))
            unit = float(np.spacing(np.float32(abs(points[k, axis]) + 1e-30)))
            assert abs(float(exact - Fraction(float(points[k, axis])))) <= unit / 2 * (1 + 1e-6) + 1e-17


def test_depth_that_is_not_a_number_is_refused() -> None:
    depth = np.full(SMALL.shape, np.inf)
    depth[3, 5] = np.nan
    for check in (lambda: touch_success(depth, SMALL), lambda: local_points(depth.astype(np.float32), np.eye(4), SMALL)):
        with pytest.raises(ValueError, match="depth holds NaN"):
            check()

"""Success of touches, and local points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.touch.depth_maps import CONTACT_MARGIN, local_points, touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from tests.kernels.touch.shapes import SENSOR, pybullet_triangles, random_pose, ray_origins


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


@pytest.mark.parametrize(("value", "dtype", "named"), [(0.0, np.float64, "float32"), (np.nan, np.float32, "NaN")])
def test_local_points_reject_other_types_and_nan(value: float, dtype: type, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        local_points(np.full(SENSOR.shape, value, dtype), np.eye(4), SENSOR)


def test_touch_success_rejects_nan() -> None:
    with pytest.raises(ValueError, match="NaN"):
        touch_success(np.full(SENSOR.shape, np.nan), SENSOR)

"""Depth maps: which touch, and how they are quantised."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.touch.depth_maps import CONTACT_MARGIN, local_points, quantise_depth, touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from tests.kernels.touch.shapes import SENSOR, pybullet_triangles, random_pose, ray_origins
from tests.strategies import seeds


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


@given(seed=seeds, gel=st.one_of(st.none(), st.integers(10, 40)), far=st.one_of(st.none(), st.integers(10, 40)))
def test_quantisation_is_idempotent(seed, gel, far) -> None:
    rng = np.random.default_rng(seed)
    depth = np.concatenate([rng.uniform(0, 0.05, 200), SENSOR.w + rng.normal(size=50) * 1e-9, [0, np.inf, np.nextafter(SENSOR.w, 0)]])
    stored = quantise_depth(depth, SENSOR, gel_bits=gel, far_bits=far)
    step = np.where(depth < SENSOR.w, *(0 if bits is None else 2.0**-bits for bits in (gel, far)))
    finite = np.isfinite(depth)
    assert np.isinf(stored[~finite]).all()
    unit = np.spacing(depth[finite].astype(np.float32)).astype(np.float64)
    assert (np.abs(stored[finite] - depth[finite]) <= (step[finite] + unit * np.where(depth[finite] < SENSOR.w, 1, 2)) / 2).all()
    assert (stored[depth >= SENSOR.w] >= SENSOR.w).all()  # nothing touches that did not
    inner = np.abs(depth - SENSOR.w) > 1e-3  # what storing does not carry from the gel to beyond it, or back
    again = quantise_depth(stored.astype(np.float64), SENSOR, gel_bits=gel, far_bits=far)
    np.testing.assert_array_equal(again[inner & finite], stored[inner & finite])


def test_quantisation_refuses_nan() -> None:
    with pytest.raises(ValueError, match="depth holds NaN"):
        quantise_depth(np.full(SENSOR.shape, np.nan), SENSOR, gel_bits=26, far_bits=18)

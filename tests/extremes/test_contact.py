"""Gels that nothing, one pixel or everything touches, lamps where they should not be, and what float32 and storing cost."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import strategies as st

from pipeline.kernels.touch.contact import CONTACT_MARGIN, local_points, touch_success
from pipeline.kernels.touch.depth_quantisation import quantise_depth
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Lights, Sensor, pixel_centres
from pipeline.kernels.touch.tactile_image import impression, tactile_image, untouched_image
from tests.extremes.profile import for_all
from tests.extremes.strategies import offsets, scales, seeds, turn
from tests.touch.scenes import SENSOR, ball, coarse, pose_at
from tests.touch.test_shading import twin

SMALL = coarse(8)
EMPTY = np.full(SMALL.shape, np.inf)
FULL = np.zeros(SMALL.shape)


def one_pixel(depth: float) -> np.ndarray:
    """A needle in the gel."""
    image = EMPTY.copy()
    image[3, 5] = depth
    return image


def with_lamp(x: float, y: float, z: float) -> Sensor:
    """The sensor whose red lamp stands there, in sensor widths."""
    return SMALL.model_copy(update={"lights": Lights(red=(x, y, z), green=SMALL.lights.green, blue=SMALL.lights.blue)})


@pytest.mark.parametrize("depth", [EMPTY, FULL, one_pixel(0.0), one_pixel(0.003)], ids=["empty", "full", "pixel through", "pixel"])
def test_a_gel_touched_nowhere_everywhere_and_by_a_needle(depth) -> None:
    assert np.abs(tactile_image(depth, SMALL).astype(int) - twin(depth, SMALL)).max() <= 1
    points, count = local_points(depth.astype(np.float32), np.eye(4), SMALL)
    assert count == np.isfinite(depth).sum()
    assert (points[count:] == 0).all()
    assert touch_success(depth, SMALL) == (depth.min() == 0.003)  # a surface in the sensor plane is no touch


def test_a_needle_in_the_gel_is_one_point() -> None:
    points, count = local_points(one_pixel(0.003).astype(np.float32), np.eye(4), SMALL)
    x, y = pixel_centres(SMALL)
    assert count == 1
    np.testing.assert_array_equal(points[0], np.float32([x[5], y[3], np.float32(0.003)]))


def test_a_surface_in_front_of_the_whole_gel() -> None:
    """A ball of a metre, and one that holds the sensor within."""
    at = pose_at(np.array([0, 0, -1.0]), np.array([0, 0, 1.0]), SENSOR.w - 0.003)
    depth = ray_depth(box_faces(ball(5, 1.0)), at, SENSOR)
    assert (depth < SENSOR.w).all()
    assert local_points(depth.astype(np.float32), at, SENSOR)[1] == 10_000
    assert np.isinf(ray_depth(box_faces(ball(5, 1.0)), np.eye(4), SENSOR)).all()


@for_all(few=30, many=300, nearest=st.floats(0, 0.01))
def test_touch_is_judged_in_float32_and_by_gel_alone(nearest) -> None:
    floor = np.array([[[-1, -1, nearest], [3, -1, nearest], [-1, 3, nearest]]])
    judged = float(np.float32(nearest))
    expected = 0 < judged < SENSOR.w - CONTACT_MARGIN
    assert touch_success(ray_depth(box_faces(floor), np.eye(4), SENSOR), SENSOR) == expected
    assert touch_success(np.full(SENSOR.shape, nearest), SENSOR) == expected
    assert touch_success(np.full(SENSOR.shape, np.float32(nearest)), SENSOR) == expected


def test_no_sensors_have_no_touches() -> None:
    assert touch_success(np.zeros((0, 4, 8, 8)), SMALL).shape == (0, 4)


@pytest.mark.parametrize("bad", [np.nan, -1e-9, -np.inf])
def test_depths_that_are_none_are_named(bad) -> None:
    with pytest.raises(ValueError, match="NaN or negative"):
        impression(one_pixel(bad), SMALL)
    if np.isnan(bad):
        for ask in (
            lambda: touch_success(one_pixel(bad), SMALL),
            lambda: local_points(one_pixel(bad).astype(np.float32), np.eye(4), SMALL),
            lambda: quantise_depth(one_pixel(bad), SMALL, gel_bits=26, far_bits=18),
        ):
            with pytest.raises(ValueError, match="depth holds NaN"):
                ask()


@pytest.mark.parametrize("deep", [0.0, 0.002, 0.0068])
def test_a_lamp_on_the_surface_does_not_light_the_point_it_stands_on(deep) -> None:
    """The gel is pressed flat, so deep, and the lamp stands on it over a pixel's centre."""
    depth = np.full(SMALL.shape, SMALL.w - deep)
    sensor = with_lamp((5 + 0.5) / 8, (3 + 0.5) / 8, (SMALL.w - depth[3, 5]) / SMALL.width or 1e-300)
    image = tactile_image(depth, sensor)
    assert image[3, 5, 0] == 0
    assert (image[..., 0] == 0).all()  # it stands in the plane: its light passes along the surface
    np.testing.assert_array_equal(image[..., 1:], tactile_image(depth, SMALL)[..., 1:])


@for_all(few=30, many=1000, seed=seeds, height=st.floats(-12, -1).map(lambda e: 10.0**e))
def test_a_lamp_next_to_the_surface_is_as_the_equations_say(seed, height) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.002, 0.009, SMALL.shape)
    row, col = rng.integers(0, 8, 2)
    sensor = with_lamp((col + 0.5) / 8 + 0.01, (row + 0.5) / 8, max(SMALL.w - depth[row, col], 0) / SMALL.width + height)
    assert np.abs(tactile_image(depth, sensor).astype(int) - twin(depth, sensor)).max() <= 1


@for_all(few=30, many=1000, seed=seeds, diffuse=st.floats(-6, 6).map(lambda e: 10.0**e))
def test_readings_go_black_and_white_and_never_around(seed, diffuse) -> None:
    """As bright or dark as one likes: intensities are clipped, not wrapped."""
    sensor = SMALL.model_copy(update={"diffuse": diffuse})
    depth = np.random.default_rng(seed).uniform(0.0, 0.01, SMALL.shape)
    image = tactile_image(depth, sensor)
    assert np.abs(image.astype(int) - twin(depth, sensor)).max() <= 1
    if diffuse < 1e-3:
        assert image.max() == 0
    if diffuse > 1e5:
        assert set(np.unique(image)) <= {0, 255}
        assert untouched_image(sensor).min() == 255


@for_all(few=20, many=1000, seed=seeds, scale=scales)
def test_a_reading_depends_on_shape_alone(seed, scale) -> None:
    depth = np.random.default_rng(seed).uniform(0.0, 0.01, SMALL.shape)
    large = SMALL.model_copy(update={"width": SMALL.width * scale, "w": SMALL.w * scale, "range": SMALL.range * scale})
    assert np.abs(tactile_image(depth * scale, large).astype(int) - tactile_image(depth, SMALL)).max() <= 1


@for_all(few=20, many=1000, seed=seeds)
def test_float32_depth_moves_no_value_by_more_than_one(seed) -> None:
    """Of smooth and of rough impressions; the bound on the intensity is 2^-23 lambda w/width times the pixels a side."""
    depth = np.random.default_rng(seed).uniform(0.0, 0.009, SENSOR.shape)
    change = tactile_image(depth.astype(np.float32), SENSOR).astype(int) - tactile_image(depth, SENSOR)
    intensity = 2.0**-23 * SENSOR.diffuse * SENSOR.w / SENSOR.width * SENSOR.cols
    assert np.abs(change).max() <= 1
    assert (change != 0).mean() <= 4 * 255 * 2 * intensity + 1e-3  # as often as a value lies so near to a half


@for_all(few=20, many=1000, seed=seeds, offset=offsets)
def test_points_are_right_to_half_a_unit_of_float32(seed, offset) -> None:
    """Against rigid motion in fractions."""
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn(rng), offset
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


@for_all(few=30, many=2000, seed=seeds, gel=st.one_of(st.none(), st.integers(10, 40)), far=st.one_of(st.none(), st.integers(10, 40)))
def test_storing_moves_a_depth_by_half_a_step_at_most_and_nothing_twice(seed, gel, far) -> None:
    rng = np.random.default_rng(seed)
    depth = np.concatenate(
        [rng.uniform(0, 0.05, 200), SENSOR.w + rng.normal(size=50) * 1e-9, [0, np.inf, 5e-324, np.nextafter(SENSOR.w, 0)]]
    )
    stored = quantise_depth(depth, SENSOR, gel_bits=gel, far_bits=far)
    step = np.where(depth < SENSOR.w, *(0 if bits is None else 2.0**-bits for bits in (gel, far)))
    finite = np.isfinite(depth)
    assert np.isinf(stored[~finite]).all()
    unit = np.spacing(depth[finite].astype(np.float32)).astype(np.float64)
    assert (np.abs(stored[finite] - depth[finite]) <= (step[finite] + unit) / 2).all()
    inner = np.abs(depth - SENSOR.w) > 1e-3  # what storing does not carry from the gel to beyond it, or back
    again = quantise_depth(stored.astype(np.float64), SENSOR, gel_bits=gel, far_bits=far)
    np.testing.assert_array_equal(again[inner & finite], stored[inner & finite])

"""Tactile images against equations 1 to 5 transcribed pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.touch.depth_maps import impression
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.sensor import Lights, Sensor
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from tests.kernels.touch.shapes import (
    SENSOR,
    ball,
    coarse,
    one_pixel,
    pybullet_triangles,
    random_pose,
)
from tests.references.slow_tactile_image import slow_tactile_image
from tests.strategies import seeds

SMALL = coarse(8)


def with_lamp(x: float, y: float, z: float) -> Sensor:
    """Move the sensor's red lamp to this place, in sensor widths."""
    return SMALL.model_copy(update={"lights": Lights(red=(x, y, z), green=SMALL.lights.green, blue=SMALL.lights.blue)})


def same(fast: np.ndarray, slow: np.ndarray) -> bool:
    """Equal but for values halfway between two integers in real arithmetic: one level, at most 1 in 10,000."""
    difference = np.abs(fast.astype(int) - slow.astype(int))
    return bool(difference.max() <= 1 and (difference > 0).mean() <= 1e-4)


def test_tactile_image_of_a_real_mesh() -> None:
    triangles = pybullet_triangles("duck.obj")
    pose = random_pose(triangles, np.random.default_rng(8))
    depth = ray_depth(box_faces(triangles), pose, SENSOR).astype(np.float32)
    assert (depth < SENSOR.w).any()
    assert same(tactile_image(depth, SENSOR), slow_tactile_image(depth, SENSOR))


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.integers(2, 9), st.floats(0.2, 2.0))
def test_tactile_image_of_random_depths_and_sensors(seed: int, rows: int, cols: int, diffuse: float) -> None:
    sensor = SENSOR.model_copy(update={"rows": rows, "cols": cols, "diffuse": diffuse, "width": 0.02})
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.004, 0.009, (rows, cols)).astype(np.float32)
    depth[rng.random((rows, cols)) < 0.2] = np.inf
    difference = np.abs(tactile_image(depth, sensor).astype(int) - slow_tactile_image(depth, sensor).astype(int))
    assert difference.max() <= 1
    assert (difference > 0).mean() <= 0.02


def test_untouched_image_saturates_nowhere() -> None:
    nothing = np.full(SENSOR.shape, np.inf, np.float32)
    image = untouched_image(SENSOR)
    assert (image == tactile_image(nothing, SENSOR)).all()
    assert same(image, slow_tactile_image(nothing, SENSOR))
    assert image.min() > 0
    assert image.max() < 255
    spread = image.reshape(-1, 3).astype(int)
    assert (np.ptp(spread, axis=0) > 50).all()
    assert not (image[..., 0] == image[..., 1]).all()


def test_surface_that_just_reaches_the_gel_leaves_it_untouched() -> None:
    assert (tactile_image(np.full(SENSOR.shape, SENSOR.w), SENSOR) == untouched_image(SENSOR)).all()
    assert (impression(np.full(SENSOR.shape, np.inf), SENSOR) == 0).all()


def test_pressed_ball_is_brightest_towards_each_lamp() -> None:
    """In each channel, light falls on the side of a pressed ball that its lamp is on."""
    depth = ray_depth(box_faces(ball(5, 0.006, z=SENSOR.w - 0.002 + 0.006)), np.eye(4), SENSOR)
    image = tactile_image(depth, SENSOR).astype(int) - untouched_image(SENSOR)
    lamps = (SENSOR.lights.red, SENSOR.lights.green, SENSOR.lights.blue)
    row, col = np.indices(SENSOR.shape)
    for channel, lamp in enumerate(lamps):
        gain = np.maximum(image[..., channel], 0)
        centre = np.array([(gain * col).sum(), (gain * row).sum()]) / gain.sum() / 100 - 0.495
        towards = np.array(lamp[:2]) - 0.5
        assert centre @ towards / np.linalg.norm(centre) / np.linalg.norm(towards) > 0.95
    assert ((image + untouched_image(SENSOR)) == 255).mean() < 0.01


def test_gradients_at_the_rim_are_one_sided() -> None:
    sensor = coarse(4)
    depth = np.full((4, 4), SENSOR.w, np.float32)
    depth[0] -= np.float32(0.001)
    assert (tactile_image(depth, sensor)[0] == slow_tactile_image(depth, sensor)[0]).all()


def test_depth_of_another_shape_or_not_a_number_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\(100, 100\)"):
        tactile_image(np.zeros((5, 5)), SENSOR)
    with pytest.raises(ValueError, match="NaN"):
        tactile_image(np.full(SENSOR.shape, np.nan), SENSOR)


@pytest.mark.parametrize("bad", [np.nan, -1e-9, -np.inf])
def test_impression_refuses_negative_depth_and_nan(bad) -> None:
    with pytest.raises(ValueError, match="NaN or negative"):
        impression(one_pixel(bad, SMALL), SMALL)


@pytest.mark.parametrize("deep", [0.002, 0.0068])
def test_lamp_on_the_surface_does_not_light_its_own_position(deep) -> None:
    """The gel is pressed flat, so deep, and the lamp stands on it over a pixel's centre."""
    depth = np.full(SMALL.shape, SMALL.w - deep)
    sensor = with_lamp((5 + 0.5) / 8, (3 + 0.5) / 8, (SMALL.w - depth[3, 5]) / SMALL.width)
    image = tactile_image(depth, sensor)
    assert image[3, 5, 0] == 0
    assert (image[..., 0] == 0).all()  # it stands in the plane: its light passes along the surface
    np.testing.assert_array_equal(image[..., 1:], tactile_image(depth, SMALL)[..., 1:])


@given(seed=seeds, height=st.floats(-12, -1).map(lambda e: 10.0**e))
def test_lamp_next_to_the_surface_follows_the_equations(seed, height) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.002, 0.009, SMALL.shape)
    row, col = rng.integers(0, 8, 2)
    sensor = with_lamp((col + 0.5) / 8 + 0.01, (row + 0.5) / 8, max(SMALL.w - depth[row, col], 0) / SMALL.width + height)
    assert np.abs(tactile_image(depth, sensor).astype(int) - slow_tactile_image(depth, sensor)).max() <= 1


@given(seed=seeds, diffuse=st.floats(-6, 6).map(lambda e: 10.0**e))
def test_intensities_are_clipped_not_wrapped(seed, diffuse) -> None:
    sensor = SMALL.model_copy(update={"diffuse": diffuse})
    depth = np.random.default_rng(seed).uniform(0.0, 0.01, SMALL.shape)
    image = tactile_image(depth, sensor)
    assert np.abs(image.astype(int) - slow_tactile_image(depth, sensor)).max() <= 1
    if diffuse < 1e-3:
        assert image.max() == 0
    if diffuse > 1e5:
        assert set(np.unique(image)) <= {0, 255}
        assert untouched_image(sensor).min() == 255


@given(seed=seeds)
def test_float32_depth_changes_values_by_at_most_one(seed) -> None:
    """Of smooth and of rough impressions; the bound on the intensity is 2^-23 lambda w/width times the pixels a side."""
    depth = np.random.default_rng(seed).uniform(0.0, 0.009, SENSOR.shape)
    change = tactile_image(depth.astype(np.float32), SENSOR).astype(int) - tactile_image(depth, SENSOR)
    intensity = 2.0**-23 * SENSOR.diffuse * SENSOR.w / SENSOR.width * SENSOR.cols
    assert np.abs(change).max() <= 1
    assert (change != 0).mean() <= 4 * 255 * 2 * intensity + 1e-3  # as often as a value lies so near to a half

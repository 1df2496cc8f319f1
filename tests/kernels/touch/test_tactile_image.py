"""Tactile images against equations 1 to 5 transcribed pixel by pixel."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.touch.depth_maps import impression
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from tests.kernels.touch.shapes import SENSOR, ball, coarse, one_pixel, pybullet_triangles, random_pose
from tests.references.slow_tactile_image import slow_tactile_image
from tests.strategies import seeds

SMALL = coarse(8)


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


@pytest.mark.parametrize(
    ("function", "depth", "named"),
    [
        (tactile_image, np.zeros((5, 5)), r"\(100, 100\)"),
        (tactile_image, np.full(SENSOR.shape, np.nan), "NaN"),
        (impression, one_pixel(-1e-9, SENSOR), "negative"),
        (impression, one_pixel(-np.inf, SENSOR), "negative"),
    ],
)
def test_invalid_depths_are_rejected(function, depth, named) -> None:
    with pytest.raises(ValueError, match=named):
        function(depth, SENSOR)

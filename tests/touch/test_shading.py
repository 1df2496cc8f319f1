"""Readings against equations 1 to 5 transcribed pixel by pixel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import impression, tactile_image, untouched_image
from tests.touch.scenes import SENSOR, ball, coarse, pybullet_triangles, random_pose
from tests.touch.twins import slow_reading


def twin(depth: np.ndarray, sensor: Sensor) -> np.ndarray:
    lamps = [sensor.lights.red, sensor.lights.green, sensor.lights.blue]
    return slow_reading(depth, sensor.width, sensor.w, sensor.diffuse, lamps)


def same(fast: np.ndarray, slow: np.ndarray) -> bool:
    """Equal but for values halfway between two integers in real arithmetic: one level, at most 1 in 10,000."""
    difference = np.abs(fast.astype(int) - slow.astype(int))
    return bool(difference.max() <= 1 and (difference > 0).mean() <= 1e-4)


def test_duck_at_full_size() -> None:
    triangles = pybullet_triangles("duck.obj")
    pose = random_pose(triangles, np.random.default_rng(8))
    depth = ray_depth(box_faces(triangles), pose, SENSOR).astype(np.float32)
    assert (depth < SENSOR.w).any()
    assert same(tactile_image(depth, SENSOR), twin(depth, SENSOR))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.integers(2, 9), st.floats(0.2, 2.0))
def test_random_maps_and_sensors(seed: int, rows: int, cols: int, diffuse: float) -> None:
    sensor = SENSOR.model_copy(update={"rows": rows, "cols": cols, "diffuse": diffuse, "width": 0.02})
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.004, 0.009, (rows, cols)).astype(np.float32)
    depth[rng.random((rows, cols)) < 0.2] = np.inf
    difference = np.abs(tactile_image(depth, sensor).astype(int) - twin(depth, sensor).astype(int))
    assert difference.max() <= 1
    assert (difference > 0).mean() <= 0.02


def test_untouched_is_the_reading_of_nothing_and_saturates_nowhere() -> None:
    nothing = np.full(SENSOR.shape, np.inf, np.float32)
    image = untouched_image(SENSOR)
    assert (image == tactile_image(nothing, SENSOR)).all()
    assert same(image, twin(nothing, SENSOR))
    assert image.min() > 0
    assert image.max() < 255
    spread = image.reshape(-1, 3).astype(int)
    assert (np.ptp(spread, axis=0) > 50).all()
    assert not (image[..., 0] == image[..., 1]).all()


def test_a_surface_that_just_reaches_the_gel_reads_as_untouched() -> None:
    assert (tactile_image(np.full(SENSOR.shape, SENSOR.w), SENSOR) == untouched_image(SENSOR)).all()
    assert (impression(np.full(SENSOR.shape, np.inf), SENSOR) == 0).all()


def test_a_ball_is_brightest_towards_each_lamp() -> None:
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


def test_rim_gradients_are_one_sided() -> None:
    sensor = coarse(4)
    depth = np.full((4, 4), SENSOR.w, np.float32)
    depth[0] -= np.float32(0.001)
    assert (tactile_image(depth, sensor)[0] == twin(depth, sensor)[0]).all()


def test_wrong_depths_are_named() -> None:
    with pytest.raises(ValueError, match=r"\(100, 100\)"):
        tactile_image(np.zeros((5, 5)), SENSOR)
    with pytest.raises(ValueError, match="NaN"):
        tactile_image(np.full(SENSOR.shape, np.nan), SENSOR)

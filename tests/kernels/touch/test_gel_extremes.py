"""Gels of any shape: strips, bulges up to their rims and next to flat, cliffs; touched nowhere, everywhere, at one pixel; any scale."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from pipeline.kernels.touch.depth_maps import gel_surface, impression, local_points, touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.sensor import Sensor, Surface
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from tests.kernels.touch.shapes import SENSOR, coarse, one_pixel, pressed_ball
from tests.references.gel_heights import gel_heights
from tests.references.slow_tactile_image import slow_tactile_image
from tests.strategies import EPS, offsets, scales, seeds

SMALL = coarse(8)


def gel(**changes) -> Sensor:
    return Sensor.model_validate({**SMALL.model_dump(), **changes})


def bulge(radius: float, along: str = "both") -> dict:
    return {"surface": {"radius": radius, "along": along}}


GELS = {
    "square": SMALL,
    "strip, 1000 times as wide as high": gel(width=0.03, height=3e-5, cols=20, rows=4),
    "strip, 1000 times as high as wide": gel(width=3e-5, height=0.03, cols=6, rows=20),
    "half a ball": gel(width=0.008, height=0.01, **bulge(np.hypot(0.004, 0.005) * (1 + 1e-9))),
    "half a cylinder, along x": gel(width=0.013, height=0.03, **bulge(0.0065 * (1 + 1e-9), "x")),
    "half a cylinder, along y": gel(width=0.03, height=0.013, **bulge(0.0065 * (1 + 1e-9), "y")),
    "next to flat": gel(**bulge(10)),
    "a cliff": gel(surface={"heights": [[1e-6, 1e-6, 0.0068, 0.0068]] * 3}),
    "a map finer than the pixels": gel(surface={"heights": np.random.default_rng(0).uniform(1e-6, 0.0068, (11, 13)).tolist()}),
}
gels = pytest.mark.parametrize("sensor", GELS.values(), ids=GELS)


def follows_equations(depth: np.ndarray, sensor: Sensor) -> bool:
    return bool(np.abs(tactile_image(depth, sensor).astype(int) - slow_tactile_image(depth, sensor)).max() <= 1)


@gels
def test_surface_is_where_rays_leave_the_gel(sensor: Sensor) -> None:
    np.testing.assert_allclose(np.broadcast_to(gel_surface(sensor), sensor.shape), gel_heights(sensor), rtol=1e-12, atol=1e-12)


@gels
def test_gel_touched_at_no_pixel_all_pixels_and_one_pixel(sensor: Sensor) -> None:
    lowest = gel_heights(sensor)[3, 5]
    for depth, pixels in (
        (np.full(sensor.shape, np.inf), 0),
        (np.zeros(sensor.shape), sensor.rows * sensor.cols),
        (one_pixel(0, sensor), 1),
    ):
        assert follows_equations(depth, sensor)
        points, count = local_points(depth.astype(np.float32), np.eye(4), sensor)
        assert (impression(depth, sensor) > 0).sum() == count == pixels
        assert (points[count:] == 0).all()
        assert not touch_success(depth, sensor)  # a surface in the sensor plane is no touch
    pressed = one_pixel(lowest / 2, sensor)
    assert follows_equations(pressed, sensor)
    assert touch_success(pressed, sensor) == (lowest / 2 > 1e-4)
    assert (tactile_image(one_pixel(2 * lowest, sensor), sensor) == untouched_image(sensor)).all()


@gels
@given(seed=seeds)
def test_image_of_any_depths_follows_the_equations(sensor: Sensor, seed: int) -> None:
    depth = np.random.default_rng(seed).uniform(0, 2 * sensor.w, sensor.shape)
    assert follows_equations(depth, sensor)


@gels
@given(seed=seeds, scale=scales)
def test_impression_and_image_ignore_scale(sensor: Sensor, seed: int, scale: float) -> None:
    depth = np.random.default_rng(seed).uniform(0, 2 * sensor.w, sensor.shape)
    surface = sensor.surface and Surface.model_construct(  # without the limits of a sensor file
        radius=sensor.surface.radius and sensor.surface.radius * scale,
        along=sensor.surface.along,
        heights=sensor.surface.heights and tuple(tuple(scale * z for z in row) for row in sensor.surface.heights),
    )
    lengths = {"width": sensor.width, "given_height": sensor.height, "w": sensor.w, "range": sensor.range}
    large = sensor.model_copy(update={**{name: length * scale for name, length in lengths.items()}, "surface": surface})
    np.testing.assert_allclose(impression(depth * scale, large) / scale, impression(depth, sensor), atol=1e-12)
    assert np.abs(tactile_image(depth * scale, large).astype(int) - tactile_image(depth, sensor)).max() <= 1


@given(seed=seeds, offset=offsets)
def test_impression_in_a_bulge_ignores_offset(seed: int, offset: np.ndarray) -> None:
    sensor = gel(height=0.03, rows=5, **bulge(0.04))
    triangles, pose = pressed_ball(np.random.default_rng(seed), np.zeros(3))
    moved = pose.copy()
    moved[:3, 3] += offset
    here = impression(ray_depth(box_faces(triangles), pose, sensor), sensor)
    there = impression(ray_depth(box_faces(triangles + offset), moved, sensor), sensor)
    assert here.max() > 0.001
    assert np.abs(there - here).max() <= 16 * EPS * np.abs(offset).max() + 1e-14


def test_nearly_flat_bulge_gives_the_image_of_a_flat_gel() -> None:
    depth = np.random.default_rng(1).uniform(0, 2 * SENSOR.w, SMALL.shape)
    round_ = GELS["next to flat"]
    lower = SMALL.width**2 / 4 / 10  # of the corners: (width² / 2) / (2 radius), and a little
    assert np.abs(impression(depth, round_) - impression(depth, SMALL)).max() < lower
    assert np.abs(tactile_image(depth, round_).astype(int) - tactile_image(depth, SMALL)).max() <= 2

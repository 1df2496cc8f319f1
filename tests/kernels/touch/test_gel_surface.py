"""Rectangular and curved gels: closed forms, and depth against brute force."""

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.kernels.touch.depth_maps import gel_surface, gel_top, impression, in_gel, local_points, quantise_depth, touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.sensor import Sensor, Surface, pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image
from tests.kernels.touch.shapes import SENSOR, pybullet_triangles, random_pose, ray_origins
from tests.references.brute_force_depth import brute_force
from tests.references.gel_heights import gel_heights
from tests.references.slow_tactile_image import slow_tactile_image

WIDE = Sensor.model_validate({**SENSOR.model_dump(), "name": "wide", "width": 0.03, "height": 0.02, "rows": 60, "cols": 120})
RADIUS = 0.04


def curved(along: str, **changes) -> Sensor:
    return WIDE.model_copy(update={"surface": Surface(radius=RADIUS, along=along), **changes})


COARSE = WIDE.model_copy(update={"rows": 16, "cols": 24})
GELS = {
    "rectangle": COARSE,
    **{along: COARSE.model_copy(update={"surface": Surface(radius=RADIUS, along=along)}) for along in ("both", "x", "y")},
    "map": COARSE.model_copy(update={"surface": Surface(heights=((0.005, 0.0068, 0.004), (0.006, 0.0065, 0.003)))}),
}


def test_pixels_of_a_rectangular_gel_fill_its_sides() -> None:
    x, y = pixel_centres(WIDE)
    assert (len(x), len(y)) == (120, 60)
    np.testing.assert_allclose([x[0], x[-1], y[0], y[-1]], [-0.015 + 0.000125, 0.015 - 0.000125, -0.01 + 0.01 / 60, 0.01 - 0.01 / 60])
    assert WIDE.pitch == pytest.approx((0.02 / 60, 0.03 / 120))
    assert SENSOR.height == SENSOR.width


@pytest.mark.parametrize("shape", list(GELS))
def test_touches_of_any_gel_equal_brute_force(shape: str) -> None:
    """Impression, points and image of a mug in a gel, against all rays x all faces, rays from the gel's surface, and equations 1 to 5."""
    sensor, triangles = GELS[shape], pybullet_triangles("objects/mug.obj")
    rng, touched = np.random.default_rng(3), 0
    for _ in range(3):
        pose = random_pose(triangles, rng)
        depth = ray_depth(box_faces(triangles), pose, sensor)
        true = brute_force(triangles, ray_origins(pose, sensor), pose[:3, 2], sensor.range)
        pressed = np.maximum(gel_heights(sensor) - true.depth, 0)
        sure = ~true.doubtful & (np.abs(gel_heights(sensor) - true.depth) > 1e-8)
        assert sure.mean() > 0.99
        np.testing.assert_allclose(impression(depth, sensor)[sure], pressed[sure], atol=1e-12)
        assert (in_gel(depth, sensor) == (pressed > 0))[sure].all()
        stored = depth.astype(np.float32)
        points, count = local_points(stored, pose, sensor)
        inside = in_gel(stored.astype(float), sensor)
        met = ray_origins(pose, sensor)[inside] + true.depth[inside, None] * pose[:3, 2]
        np.testing.assert_allclose(points[:count][sure[inside]], met[sure[inside]], atol=1e-7)
        difference = np.abs(tactile_image(depth, sensor).astype(int) - slow_tactile_image(depth, sensor))
        assert difference.max() <= 1
        assert (difference > 0).mean() < 0.01
        touched += count
    assert touched > 100


EXTREMES = {
    "strip": {"width": 0.03, "height": 3e-5},
    "half a ball": {"width": 0.008, "height": 0.01, "surface": {"radius": np.hypot(0.004, 0.005) * (1 + 1e-9)}},
    "half a cylinder": {"width": 0.013, "height": 0.03, "surface": {"radius": 0.0065 * (1 + 1e-9), "along": "x"}},
    "a cliff": {"surface": {"heights": [[1e-6, 1e-6, 0.0068, 0.0068]] * 3}},
    "a fine map": {"surface": {"heights": np.random.default_rng(0).uniform(1e-6, 0.0068, (21, 43)).tolist()}},
}


@pytest.mark.parametrize("shape", list(EXTREMES))
def test_gels_of_extreme_shapes_follow_the_equations(shape: str, rng: np.random.Generator) -> None:
    """Touched nowhere, everywhere, and at random depths; a surface in the sensor plane is no touch."""
    sensor = Sensor.model_validate({**COARSE.model_dump(), **EXTREMES[shape]})
    np.testing.assert_allclose(np.broadcast_to(gel_surface(sensor), sensor.shape), gel_heights(sensor), rtol=1e-12, atol=1e-12)
    for depth in (np.full(sensor.shape, np.inf), np.zeros(sensor.shape), rng.uniform(0, 2 * sensor.w, sensor.shape)):
        assert np.abs(tactile_image(depth, sensor).astype(int) - slow_tactile_image(depth, sensor)).max() <= 1
        assert local_points(depth.astype(np.float32), np.eye(4), sensor)[1] == (impression(depth, sensor) > 0).sum()
    assert not touch_success(np.zeros(sensor.shape), sensor)


def test_gel_surface_is_a_sphere_a_cylinder_or_a_height_map() -> None:
    x, y = np.meshgrid(*pixel_centres(WIDE))
    for along, squared in {"both": x**2 + y**2, "x": x**2, "y": y**2}.items():
        below = WIDE.w - gel_surface(curved(along))
        np.testing.assert_allclose((RADIUS - below) ** 2 + squared, RADIUS**2, rtol=1e-12)
    tilted = WIDE.model_copy(update={"surface": Surface(heights=((0.001, 0.003), (0.002, 0.004)))})
    np.testing.assert_allclose(gel_surface(tilted), 0.0025 + 0.002 * x / 0.03 + 0.001 * y / 0.02, rtol=1e-12)
    assert gel_surface(WIDE) == WIDE.w


def test_gel_higher_than_its_middle_extends_to_its_top() -> None:
    rises = Sensor.model_validate({**WIDE.model_dump(), "surface": {"heights": [[WIDE.w, WIDE.w], [WIDE.w + 0.004, WIDE.w + 0.004]]}})
    assert [gel_top(sensor) for sensor in (WIDE, curved("both"), rises)] == pytest.approx([WIDE.w, WIDE.w, WIDE.w + 0.004], abs=1e-4)
    depth = np.full(rises.shape, WIDE.w + 0.0010013)
    for sensor, step in ((rises, 2.0**-26), (WIDE, 2.0**-18)):
        assert np.abs(quantise_depth(depth, sensor, gel_bits=26, far_bits=18) % step).max() == 0
    assert np.abs(quantise_depth(depth, rises, gel_bits=26, far_bits=18) - depth).max() < 2.0**-26


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"surface": {"radius": 0.015}}, "a gel of radius 0.015 m and thickness w 0.0068 m ends before its rim"),
        ({"surface": {"heights": [[0.001, 0.002], [0.001]]}}, "heights must be a grid of 2 x 2 or more"),
        ({"range": 0.001}, r"range 0.001 m ends inside the gel, which is 0.0068 m high"),
        ({"range": 0.008, "surface": {"heights": [[0.001, 0.01]] * 2}}, "ends inside the gel, which is 0.01 m high"),
        ({"surface": {}}, "give either a radius or heights"),
        ({"lights": None}, "give either lights .* or calibrated"),
        ({"calibrated": {"coefficients": [[[1.0]]] * 3, "background": [[0, 0, 0]]}, "lights": None}, "there must be 3, each with one of"),
        ({"calibrated": {"coefficients": [[[1.0]] * 2] * 3, "background": [[0, 0, 0]] * 2}, "lights": None}, "background has 2 terms"),
        (
            {"calibrated": {"coefficients": [[[1.0]] * 2] * 3, "depth": [[1.0, 2.0]] * 3, "background": [[0, 0, 0]]}, "lights": None},
            r"depth has \[2, 2, 2\] terms .* coefficients have, 1",
        ),
    ],
)
def test_invalid_sensor_is_refused(changes, message) -> None:
    with pytest.raises(ValidationError, match=message):
        Sensor.model_validate({**WIDE.model_dump(), **changes})

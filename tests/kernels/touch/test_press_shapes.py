"""Shapes pressed without a hand: their depths are those drawn, a ball is a ball, and a patch of a mesh is that mesh, smaller."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import gel_surface, impression
from pipeline.kernels.touch.press_shapes import SHAPES, PressRanges, draw_patch, first_that_fits, press_drawn, press_relief, random_press
from pipeline.kernels.touch.ray_depth import box_faces
from pipeline.kernels.touch.sensor import pixel_centres, resample
from pipeline.kernels.touch.tactile_image import untouched_image
from schemas.presses import PRESSED
from tests.kernels.touch.shapes import ball, sheet

GELSIGHT = load_sensor("gelsight", shape=(60, 80)).model_copy(update={"membrane": 0.0009, "gel": None})
DIGIT = load_sensor("digit", shape=(90, 60))
RANGES = PressRanges(size=(0.002, 0.006), depth=(0.0002, 0.001))


@pytest.mark.parametrize("sensor", [GELSIGHT, DIGIT], ids=["flat", "curved"])
@pytest.mark.parametrize("name", SHAPES)
def test_shape_is_pressed_to_the_drawn_depth(name, sensor):
    for number in range(20):
        press = random_press(sensor, np.random.default_rng(number), RANGES, [name])
        assert press.shape == name
        assert press.depth.shape == sensor.shape
        assert not np.isnan(press.depth).any()
        assert press.depth.min() > 0
        assert press.depth[np.isfinite(press.depth)].max() <= sensor.range
        assert RANGES.depth[0] <= impression(press.depth, sensor).max() <= RANGES.depth[1] + 1e-12


def test_middles_beyond_the_gel_make_more_contacts_that_its_rim_cuts():
    cut = {}
    for middle in (0.5, 0.9):
        ranges, rims = PressRanges(size=(0.002, 0.004), depth=(0.0003, 0.0006), middle=middle), []
        for number in range(40):
            pressed = impression(random_press(GELSIGHT, np.random.default_rng(number), ranges, ["ball"]).depth, GELSIGHT) > 0
            rims.append(pressed.any() and (pressed[[0, -1]].any() or pressed[:, [0, -1]].any()))
        cut[middle] = np.mean(rims)
    assert cut[0.9] > cut[0.5] + 0.2


def test_every_code_of_the_schema_names_a_shape():
    assert ("patch", *SHAPES) == PRESSED


def test_relief_is_pressed_to_its_depth_whatever_its_offset():
    x, y = np.meshgrid(*pixel_centres(GELSIGHT))
    relief = np.sqrt(np.maximum(0.004**2 - (x - 0.001) ** 2 - y**2, 0))
    relief[relief == 0] = -np.inf
    depth = press_relief(relief, GELSIGHT, 5e-4)
    np.testing.assert_allclose(depth, press_relief(relief + 0.3, GELSIGHT, 5e-4), atol=1e-15)
    assert (depth - GELSIGHT.w).min() == pytest.approx(-5e-4)
    reach = np.hypot(x - 0.001, y)[impression(depth, GELSIGHT) > 0].max()
    assert reach == pytest.approx(np.sqrt(2 * 0.004 * 5e-4 - 5e-4**2), abs=GELSIGHT.pitch[0])
    curved = press_relief(np.zeros(DIGIT.shape), DIGIT, 3e-4)  # a plate touches a bulge in the middle
    assert np.ptp(curved) == 0
    assert (gel_surface(DIGIT) - curved).max() == pytest.approx(3e-4)


def test_a_patch_of_a_ball_is_a_smaller_ball():
    faces, rng = box_faces(ball(5, 0.1)), np.random.default_rng(3)
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for _ in range(10):
        press = press_drawn(partial(draw_patch, faces, 0.1 * normals, normals), GELSIGHT, rng, replace(RANGES, scale=(0.1, 0.1)))
        assert press.shape == "patch"
        pressed = impression(press.depth, GELSIGHT)
        row, col = np.nonzero(np.isfinite(press.depth))
        x, y = pixel_centres(GELSIGHT)
        points = np.stack([x[col], y[row], press.depth[row, col]], axis=1)
        system = np.column_stack([2 * points, np.ones(len(points))])
        *centre, rest = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
        assert np.sqrt(rest + np.square(centre).sum()) == pytest.approx(0.01, rel=0.02)
        assert RANGES.depth[0] <= pressed.max() <= RANGES.depth[1] + 1e-12


def test_a_sensor_with_other_pixels_has_the_same_gel_and_background():
    whole = load_sensor("gelsight")
    assert resample(whole, *whole.shape) is whole
    assert (GELSIGHT.shape, GELSIGHT.width, GELSIGHT.height) == ((60, 80), whole.width, whole.height)
    mean = untouched_image(whole).reshape(60, 8, 80, 8, 3).mean(axis=(1, 3))
    assert np.abs(untouched_image(GELSIGHT) - mean).max() < 2
    for wrong in ((1, 80), (60, 5000), (60.5, 80)):
        with pytest.raises(InvalidInput, match="from 2 to 4096 rows and columns of pixels; these are"):
            resample(whole, *wrong)


def test_a_photographed_background_is_resized_with_the_pixels():
    photograph = untouched_image(load_sensor("gelsight", shape=(48, 64)))
    optics = GELSIGHT.calibrated.model_copy(update={"background": "untouched.png"})
    sensor = GELSIGHT.model_copy(update={"rows": 48, "cols": 64, "calibrated": optics, "photograph": photograph.tobytes()})
    assert (untouched_image(sensor) == photograph).all()
    half = untouched_image(resample(sensor, 24, 32)).astype(float)
    assert np.abs(half - photograph.reshape(24, 2, 32, 2, 3).mean(axis=(1, 3)))[1:-1, 1:-1].max() < 2
    assert untouched_image(resample(sensor, 96, 128)).shape == (96, 128, 3)


EMPTY, FLAT = np.full((60, 80), -np.inf), np.zeros((60, 80))
FLAT_ON = PressRanges(tilt=0.0, scale=(0.1, 0.1))
EDGE_ON = box_faces(sheet(0.0, 0.1)), np.zeros((1, 3)), np.array([[1.0, 0, 0]])


@pytest.mark.parametrize(
    ("press", "named"),
    [
        (lambda rng: press_relief(EMPTY, GELSIGHT, 1e-3), "no surface"),
        (lambda rng: press_relief(FLAT, GELSIGHT, 0.0), "depth is 0"),
        (lambda rng: press_relief(FLAT, GELSIGHT, 0.004), "depth is 0.004 m"),
        (lambda rng: press_relief(FLAT, GELSIGHT, np.nan), "depth is nan"),
        (lambda rng: press_relief(FLAT.T, GELSIGHT, 1e-3), r"\(80, 60\).*\(60, 80\)"),
        (lambda rng: press_relief(np.full((60, 80), np.nan), GELSIGHT, 1e-3), "NaN"),
        (lambda rng: random_press(GELSIGHT, rng, shapes=["bal"]), "'bal'"),
        (lambda rng: random_press(GELSIGHT, rng, PressRanges(size=(1e-6, 1e-6)), ["ball"]), "20 shapes"),
        (
            lambda rng: first_that_fits(press_drawn, partial(draw_patch, *EDGE_ON), GELSIGHT, rng, FLAT_ON),
            "20 .*unit is right",
        ),
    ],
)
def test_shapes_that_cannot_be_pressed_are_rejected(press, named, rng):
    with pytest.raises(ValueError, match=named):
        press(rng)

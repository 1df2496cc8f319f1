"""Shapes pressed without a hand: their depths are those drawn, a ball is a ball, and a patch of a mesh is that mesh, smaller."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import gel_surface, impression
from pipeline.kernels.touch.press_shapes import SHAPES, PressRanges, press_relief, random_patch, random_press
from pipeline.kernels.touch.pressed_gel import press_gel
from pipeline.kernels.touch.ray_depth import box_faces
from pipeline.kernels.touch.sensor import pixel_centres, resample
from pipeline.kernels.touch.tactile_image import render_gel, tactile_image, untouched_image
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


def test_shapes_differ_and_every_code_names_a_shape():
    assert ("patch", *SHAPES) == PRESSED
    drawn = [random_press(GELSIGHT, np.random.default_rng(number)) for number in range(100)]
    assert {press.shape for press in drawn} == set(SHAPES)
    assert len({press.depth.tobytes() for press in drawn}) == 100
    again = random_press(GELSIGHT, np.random.default_rng(7))
    assert (again.depth == drawn[7].depth).all()


@pytest.mark.parametrize("name", ["ball", "prism", "stairs", "relief"])
def test_press_does_not_depend_on_the_resolution(name):
    fine, coarse = load_sensor("gelsight", shape=(180, 240)), GELSIGHT  # the middle of three pixels is that of one
    for number in range(10):
        both = [impression(random_press(worn, np.random.default_rng(number), RANGES, [name]).depth, worn) for worn in (fine, coarse)]
        unlike = np.abs(both[0][1::3, 1::3] - both[1])
        assert (unlike < 2e-4).mean() > 0.95  # their deepest pixels differ, and so do the heights by as much


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


@pytest.mark.parametrize(
    ("relief", "depth", "message"),
    [
        (np.full((60, 80), -np.inf), 1e-3, "no surface"),
        (np.zeros((60, 80)), 0.0, "more than 0 and less than the gel"),
        (np.zeros((60, 80)), 0.004, "depth is 0.004 m; a press into sensor 'gelsight' is more than 0 and less than the gel, 0.004 m"),
        (np.zeros((60, 80)), np.nan, "depth is nan"),
    ],
)
def test_relief_that_cannot_be_pressed_is_refused(relief, depth, message):
    with pytest.raises(InvalidInput, match=message):
        press_relief(relief, GELSIGHT, depth)


def test_relief_of_wrong_shape_or_with_nan_raises_value_error():
    with pytest.raises(ValueError, match=r"relief has shape \(80, 60\); sensor 'gelsight' has \(60, 80\)"):
        press_relief(np.zeros((80, 60)), GELSIGHT, 1e-3)
    with pytest.raises(ValueError, match="NaN"):
        press_relief(np.full((60, 80), np.nan), GELSIGHT, 1e-3)
    with pytest.raises(InvalidInput, match="there is no shape 'bal'; there are ball, ellipsoid"):
        random_press(GELSIGHT, np.random.default_rng(0), shapes=["bal"])


def test_presses_are_drawn_again_where_the_gel_is_thin_and_end_where_none_fits():
    dome = GELSIGHT.model_copy(update={"surface": DIGIT.surface.model_copy(update={"radius": 0.0125, "along": "both"})})
    rng, rim = np.random.default_rng(0), gel_surface(dome).min()
    assert rim < PressRanges().depth[1]
    assert all((gel_surface(dome) - random_press(dome, rng).depth).max() > 0 for _ in range(200))
    with pytest.raises(InvalidInput, match="none of 20 shapes that were drawn can be pressed: the relief has no surface"):
        random_press(GELSIGHT, rng, PressRanges(size=(1e-6, 1e-6)), ["ball"])


def test_a_patch_of_a_ball_is_a_smaller_ball():
    faces, rng = box_faces(ball(5, 0.1)), np.random.default_rng(3)
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for _ in range(10):
        press = random_patch(faces, 0.1 * normals, normals, GELSIGHT, rng, ranges=RANGES, scale=(0.1, 0.1))
        assert press.shape == "patch"
        pressed = impression(press.depth, GELSIGHT)
        row, col = np.nonzero(np.isfinite(press.depth))
        x, y = pixel_centres(GELSIGHT)
        points = np.stack([x[col], y[row], press.depth[row, col]], axis=1)
        system = np.column_stack([2 * points, np.ones(len(points))])
        *centre, rest = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
        assert np.sqrt(rest + np.square(centre).sum()) == pytest.approx(0.01, rel=0.02)
        assert RANGES.depth[0] <= pressed.max() <= RANGES.depth[1] + 1e-12


def test_object_without_a_patch_is_named():
    edge_on = box_faces(sheet(0.0, 0.1))
    with pytest.raises(InvalidInput, match="none of 20 patches that were drawn can be pressed: the relief has no surface"):
        random_patch(edge_on, np.zeros((1, 3)), np.array([[1.0, 0, 0]]), GELSIGHT, np.random.default_rng(0), ranges=PressRanges(tilt=0.0))


def test_gel_follows_the_shape_in_the_contact_and_its_image_follows_from_the_depth():
    press = random_press(GELSIGHT, np.random.default_rng(11), RANGES, ["ball"])
    gel = press_gel(press.depth, GELSIGHT)
    pressed = impression(press.depth, GELSIGHT)
    assert gel.pressure is None
    assert gel.contact.any()
    assert (pressed[gel.contact] > 0).all()
    assert (gel.indentation[gel.contact] == pressed[gel.contact]).all()
    assert (gel.indentation >= pressed).all()
    assert (gel.indentation[~gel.contact] > 0).any()  # drawn in
    assert (render_gel(gel.indentation, GELSIGHT) == tactile_image(press.depth, GELSIGHT)).all()


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

    with io.BytesIO() as file:
        Image.fromarray(photograph).save(file, "PNG")
        content = file.getvalue()
    optics = GELSIGHT.calibrated.model_copy(update={"background": "untouched.png"})
    sensor = GELSIGHT.model_copy(update={"rows": 48, "cols": 64, "calibrated": optics, "photograph": content})
    assert (untouched_image(sensor) == photograph).all()
    half = untouched_image(resample(sensor, 24, 32)).astype(float)
    assert np.abs(half - photograph.reshape(24, 2, 32, 2, 3).mean(axis=(1, 3)))[1:-1, 1:-1].max() < 2
    assert untouched_image(resample(sensor, 96, 128)).shape == (96, 128, 3)

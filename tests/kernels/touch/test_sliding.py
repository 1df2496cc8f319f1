"""Quantities of the steps of a slide, as datasets store them."""

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import normal_force
from pipeline.kernels.touch.markers import MarkerGrid, dot_displacement
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.sliding import QUANTITIES, SlideStep, measure_steps, slide_gel
from pipeline.kernels.touch.tactile_image import render_gel
from schemas.sequences import over_time

DOTS = MarkerGrid(rows=3, cols=4, radius=4e-4)
SENSOR = load_sensor("gelsight", shape=(36, 48)).model_copy(update={"markers": DOTS})
RADIUS = 0.006


def views(deep: list[float], along: list[float]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Press a ball, whose frame is the sensor's first, and move the sensor along x."""
    x, y = pixel_centres(SENSOR)
    seen = []
    for depth, aside in zip(deep, along, strict=True):
        pose = np.eye(4)
        pose[0, 3], pose[2, 3] = aside, depth
        squared = (x[None] + aside) ** 2 + y[:, None] ** 2
        height = SENSOR.w + RADIUS - depth - np.sqrt(np.maximum(RADIUS**2 - squared, 0))
        seen.append((np.where(squared < RADIUS**2, height, np.inf).astype(np.float32), pose))
    return seen


PATH = views([-1e-5, 3e-4, 3e-4, -1e-5], [0, 0, 2e-4, 2e-4])


def steps() -> list[SlideStep]:
    return list(slide_gel(PATH, SENSOR, 0.5))


def test_quantities_are_those_of_the_schema_with_its_types_and_dimensions():
    stored = measure_steps(steps(), QUANTITIES)
    declared = over_time("slide", "step")
    assert {f"slide_{name}" for name in stored} | {"slide_time"} == set(declared)
    for name, values in stored.items():
        array = declared[f"slide_{name}"]
        assert (values.dtype.name, values.ndim) == (array.dtype, len(array.dims)), name
        assert len(values) == 4


def test_stored_quantities_are_the_steps():
    moved = steps()
    stored = measure_steps(moved, QUANTITIES)
    slid = moved[2]
    np.testing.assert_allclose(stored["shear"][2], slid.displacement, atol=2.0**-23)
    for name, exact in (("pressure", slid.gel.pressure), ("slip", slid.slip), ("traction", slid.traction)):
        np.testing.assert_allclose(stored[name][2], exact, rtol=2.0**-12)
        assert ((stored[name][2] == 0) == (exact == 0)).all()
    assert stored["force"][2] == pytest.approx([*slid.shear_force, -normal_force(slid.gel.pressure, SENSOR)])
    assert stored["force"][2][0] < 0  # the ball lags behind the sensor
    assert stored["slip_share"][2] == pytest.approx(slid.slip_share)
    at = DOTS.positions(SENSOR.width, SENSOR.height)
    np.testing.assert_allclose(stored["marker_displacement"][2], dot_displacement(at, slid.displacement, SENSOR.pitch), atol=1e-9)
    assert not stored["shear"][[0, 3]].any()
    assert not stored["force"][[0, 3]].any()
    assert stored["settled"].all()


def test_markers_darken_the_image_where_they_are():
    image = measure_steps(steps(), ["tactile_image"])["tactile_image"][2]
    plain = render_gel(steps()[2].gel.indentation, SENSOR)
    changed = (image != plain).any(axis=-1)
    assert 0 < changed.sum() < 12 * 30
    assert image[changed].mean() < plain[changed].mean() / 2


def test_path_goes_on_from_a_step_as_if_it_had_not_ended():
    first = list(slide_gel(PATH[:2], SENSOR, 0.5))
    (third,) = slide_gel(PATH[2:3], SENSOR, 0.5, after=first[-1])
    assert (third.traction == steps()[2].traction).all()


def test_path_that_begins_in_contact_or_jumps_is_refused():
    with pytest.raises(InvalidInput, match=r"poses\[0\] is in contact, 0.294 mm deep"):
        next(slide_gel(PATH[1:], SENSOR, 0.5))
    with pytest.raises(InvalidInput, match=r"poses\[1\]: the object moves by 0.00601 m"):
        list(slide_gel(views([-1e-5, 3e-4], [0, 0.006]), SENSOR, 0.5))


def test_markers_need_a_sensor_that_has_some():
    bare = SENSOR.model_copy(update={"markers": None})
    with pytest.raises(ValueError, match="no markers"):
        measure_steps(slide_gel(PATH, bare, 0.5), ["marker_displacement"])

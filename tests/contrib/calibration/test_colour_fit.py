"""Fitted gels and colours, and the range in which they were fitted."""

import numpy as np
import pytest

from pipeline.contrib.calibration.ball_contact import (
    CONTACT_WEIGHT,
    Circle,
    Photograph,
    ball_impression,
    contact_box,
    left_out_errors,
    sample_photographs,
)
from pipeline.contrib.calibration.colour_fit import MODULUS, ColourFitOptions, _choose_gel, _GelShape, fit_colours, missing_photographs
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.calibrated_shading import fitted_range
from pipeline.kernels.touch.sensor import Gel, Sensor
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image

BALL = 0.002
SMALL = load_sensor("gelsight").model_copy(update={"rows": 72, "cols": 96, "membrane": 0.0, "gel": None})
RADIUS = 9.0 * SMALL.pitch[1]


def photographs(sensor: Sensor, count: int = 8) -> list[Photograph]:
    """Contacts of 9 pixels radius all over the gel, one of which the rim cuts."""
    rng = np.random.default_rng(0)
    contacts = [Circle(4.0, 30.0, 9.0)] + [Circle(rng.uniform(10, 85), rng.uniform(10, 61), 9.0) for _ in range(count - 1)]
    images = [tactile_image(sensor.w - ball_impression(sensor, circle, BALL), sensor, rng) for circle in contacts]
    return [Photograph(f"{number}.png", image, circle) for number, (image, circle) in enumerate(zip(images, contacts, strict=True))]


def of_degree(degree: int) -> Sensor:
    """Keep the terms of the normal, of the position up to some degree, and no shadows."""
    calibration = SMALL.calibrated
    assert calibration is not None
    terms = (degree + 1) * (degree + 2) // 2
    coefficients = tuple(tuple(term[:terms] for term in colour) for colour in calibration.coefficients)
    return SMALL.model_copy(
        update={"calibrated": calibration.model_copy(update={"coefficients": coefficients, "depth": None, "shadows": ()})}
    )


@pytest.mark.parametrize("degree", [0, 1])
def test_fit_chooses_the_degree_in_position_that_predicts_best(degree: int) -> None:
    sensor = of_degree(degree).model_copy(update={"noise": 1.0})
    fit = fit_colours(sensor, photographs(sensor), untouched_image(sensor), BALL, ColourFitOptions(shadows=0, elastic=False))
    assert fit.position_degree == degree
    assert fit.doubts == ()


@pytest.mark.parametrize("elastic", [True, False])
def test_fit_recovers_the_membrane_or_elastic_layer_of_the_photographs(elastic: bool) -> None:
    """An elastic layer of two contact radii and a membrane of half a radius are distinguished."""
    gel = {"gel": Gel(modulus=MODULUS, thickness=2 * RADIUS)} if elastic else {"membrane": 0.5 * RADIUS}
    sensor = of_degree(0).model_copy(update=gel)
    fit = fit_colours(sensor, photographs(sensor, 5), untouched_image(sensor), BALL, ColourFitOptions(position_degree=0, shadows=0))
    assert fit.sensor.membrane == pytest.approx(sensor.membrane, abs=1e-6)
    assert (fit.sensor.gel is not None) == elastic
    if fit.sensor.gel is not None:
        assert fit.sensor.gel.thickness == pytest.approx(2 * RADIUS, abs=1e-6)
    assert fit.doubts == ()


def test_cross_validation_error_equals_that_of_a_fit_to_the_other_photographs() -> None:
    """Beside least squares of stacked rows, a fit per photograph; the ridge is what is left between them."""
    sensor = of_degree(1)
    every = photographs(sensor)
    within = contact_box(sensor, [one.contact for one in every])
    samples = sample_photographs(sensor, every, untouched_image(sensor), ball_radius=BALL, degrees=(2, 1), within=within)
    errors = []
    for left_out in samples:
        others = [sample for sample in samples if sample is not left_out]
        weight = np.concatenate([np.where(sample.distance < 1, CONTACT_WEIGHT, 1.0) for sample in others])[:, None]
        rows, change = (np.concatenate([getattr(sample, name) for sample in others]) for name in ("features", "change"))
        coefficients = np.linalg.lstsq(weight * rows, weight * change, rcond=None)[0]
        size = np.abs(left_out.features @ coefficients - left_out.change).mean(axis=1)
        contact, ring = left_out.distance < 1, left_out.distance >= 1
        per_radius = 1 / left_out.distance[ring]
        errors.append(size[contact].mean() + (size[ring] * per_radius).sum() / per_radius.sum())
    assert left_out_errors(samples) == pytest.approx(errors, rel=2e-2)
    assert np.mean(errors) > 0.1


SENSOR = load_sensor("gelsight")
OPTICS = SENSOR.calibrated
EVERYWHERE = [Circle(x, y, 60.0) for x in (100.0, 320.0, 540.0) for y in (80.0, 240.0, 400.0)]


def test_box_of_contacts_is_in_the_sensor_frame() -> None:
    circle = Circle(319.5, 239.5, 100.0)  # in the middle of 640 x 480 pixels of 0.0295 mm
    assert contact_box(SENSOR, [circle]) == pytest.approx((-0.00295, -0.00295, 0.00295, 0.00295), abs=1e-5)
    left, top, right, bottom = contact_box(SENSOR, [circle, Circle(419.5, 239.5, 50.0)])
    assert (left, right) == pytest.approx((-0.00295, 0.00443), abs=1e-5)
    assert (top, bottom) == pytest.approx((-0.00295, 0.00295), abs=1e-5)


def test_fitted_range_is_described_and_files_without_one_are_reported_to_extrapolate() -> None:
    assert fitted_range(OPTICS)[0] == "fitted: slopes up to 64 degrees, contacts up to 2.00 mm deep, x -8.5 to 8.9 mm, y -5.0 to 5.8 mm"
    (line,) = fitted_range(OPTICS.model_copy(update={"within": None}))
    assert "colours elsewhere are extrapolated, calibrate again" in line


def test_thirds_without_a_contact_and_missing_slopes_are_named() -> None:
    assert missing_photographs(SENSOR, OPTICS, EVERYWHERE) == []
    lines = missing_photographs(SENSOR, OPTICS.model_copy(update={"steepest": 0.515}), EVERYWHERE[1:8])
    assert lines == [
        "no contact in the upper left, lower right of the gel: press there",
        "no slope steeper than 31 degrees: press deeper, or use a smaller ball",
    ]
    beyond = Circle(-4.0, -4.0, 60.0)  # of a contact that the corner cuts
    assert missing_photographs(SENSOR, OPTICS, [beyond, *EVERYWHERE[1:]]) == ["no contact in the upper left of the gel: press there"]
    coefficients = tuple(tuple(term[:1] for term in colour) for colour in OPTICS.coefficients)
    everywhere_alike = OPTICS.model_copy(update={"coefficients": coefficients, "steepest": 0.433})
    assert missing_photographs(SENSOR, everywhere_alike, EVERYWHERE[:1]) == [
        "no slope steeper than 26 degrees: press deeper, or use a smaller ball"
    ]


def test_layer_on_which_contacts_disagree_is_held_at_the_assumed_thickness() -> None:
    """Errors of two small and two large contacts by gel; the last is the assumed one."""
    gels = [_GelShape(True, size) for size in (0.7, 1.4, 2.8, 4.0)]
    sizes = np.array([20.0, 8.0, 9.0, 21.0])
    agree = np.array([[9, 9, 9, 9], [5, 5, 5, 5], [7, 7, 7, 7], [8, 8, 8, 8]], float)
    assert _choose_gel(gels, agree, sizes, 1e-3) == (gels[1], [])
    disagree = np.array([[9, 3, 3, 9], [5, 5, 5, 5], [4, 9, 9, 4], [8, 8, 8, 8]], float)
    chosen, doubts = _choose_gel(gels, disagree, sizes, 1e-3)
    assert chosen == gels[3]
    assert "smaller and larger contacts ask for 0.7 mm and 2.8 mm" in doubts[0]
    assert "the thickness of the gel, 4 mm, is taken, which --thickness states" in doubts[0]
    chosen, doubts = _choose_gel(gels, agree[[0, 2, 3, 1]], sizes, 1e-3)
    assert chosen == gels[3]
    assert "no elastic layer that is thinner than the gel" in doubts[0]

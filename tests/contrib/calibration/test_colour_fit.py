"""Fits to photographs rendered with a known model: chosen options and their errors."""

import numpy as np
import pytest

from pipeline.contrib.calibration.ball_contact import (
    CONTACT_WEIGHT,
    Circle,
    Photograph,
    ball_impression,
    contact_box,
    left_out_error,
    sample_photographs,
)
from pipeline.contrib.calibration.colour_fit import MODULUS, ColourFitOptions, fit_colours
from pipeline.formats.sensor_file import load_sensor
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
    assert fit.at_end == ()


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
    assert fit.at_end == ()


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
    assert left_out_error(samples) == pytest.approx(np.mean(errors), rel=1e-2)
    assert np.mean(errors) > 0.1

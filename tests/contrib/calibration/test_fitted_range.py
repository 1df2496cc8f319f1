"""Messages about the fitted range of a calibration and the photographs that it lacks."""

import pytest

from pipeline.contrib.calibration.ball_contact import Circle, contact_box
from pipeline.contrib.calibration.colour_fit import missing_photographs
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.calibrated_shading import fitted_range

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

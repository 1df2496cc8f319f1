"""Settings of a sensor file against photographs: each changes the image of a contact, on the background that it names."""

import numpy as np

from benchmarks.tradeoff.sensor_settings import _variants
from pipeline.formats.sensor_file import load_sensor
from pipeline.inference.calibrate_sensor import render_contact
from pipeline.kernels.touch.calibration_fit import Circle, Photograph
from pipeline.kernels.touch.tactile_image import untouched_image

SENSOR = load_sensor("gelsight").model_copy(update={"rows": 48, "cols": 64})


def test_each_setting_of_a_sensor_changes_the_image_of_a_contact():
    contact, untouched = Circle(32, 24, 4), np.full((48, 64, 3), 90, np.uint8)
    one = Photograph("one.png", untouched, contact)
    images = {label: model(one, sensor) for label, sensor, model in _variants(SENSOR, untouched)}
    assert len({image.tobytes() for image in images.values()}) == len(images) == 8
    shipped, *_ = images.values()
    assert (shipped == render_contact(SENSOR, SENSOR.calibrated, one, untouched, 0.002)).all()
    for label, image in images.items():  # far from the contact there is the background, and noise
        expected = untouched_image(SENSOR)[0, 0] if "background" in label else 90
        assert "one colour" in label or np.abs(image[0, 0].astype(int) - expected).max() <= (9 if "noise" in label else 0), label

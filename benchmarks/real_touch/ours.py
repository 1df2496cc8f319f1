"""Ours: a sensor calibrated with photographs of balls, and a network that has seen simulated presses of it alone."""

from __future__ import annotations

from benchmarks.real_touch.photograph_sets import PhotographSet
from pipeline.kernels.touch.colour_fit import FitOptions, fit_colours
from pipeline.kernels.touch.sensor import Sensor

THICKNESS = 4e-3
"""m, assumed of the gel: it limits how deep a press can be, and no photograph tells it."""


THICKNESSES, POISSON, CONTACT_WEIGHT = (2.0,), 0.3, 30.0
"""Of the gel, in contact radii; its ratio; and the weight of pixels in contacts. Colours are those of the balls' slopes; of the gels that
explain the rings around the balls equally well, this is the thinnest. A membrane leaves a step at walls, which no network can read."""


def calibrated_sensor(photographs: PhotographSet) -> Sensor:
    """Calibrate a sensor as `calibrate-sensor` does, with all balls of a set."""
    rows, cols = photographs.untouched.shape[:2]
    pitch = 1e-3 * photographs.mm_per_pixel
    sensor = Sensor.model_validate(
        {
            "name": photographs.name,
            "width": cols * pitch,
            "height": rows * pitch,
            "rows": rows,
            "cols": cols,
            "w": THICKNESS,
            "range": 5 * THICKNESS,
            "noise": "none",
            "calibrated": {"coefficients": [[[0.0]] * 2] * 3, "background": [(0.0, 0.0, 0.0)]},
        }
    )
    options = FitOptions(elastic=True, thicknesses=THICKNESSES, poisson=POISSON, contact_weight=CONTACT_WEIGHT)
    fit = fit_colours(sensor, photographs.balls, photographs.untouched, 1e-3 * photographs.ball_radius, options)
    optics = fit.calibration.model_copy(update={"background": photographs.untouched_path.name})
    print(f"{photographs.name}: degree {fit.position_degree} in the position, gel {fit.sensor.gel}", flush=True)
    return fit.sensor.model_copy(update={"calibrated": optics, "photograph": photographs.untouched_path.read_bytes()})

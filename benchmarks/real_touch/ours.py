"""Ours: a sensor calibrated with photographs of balls, and a network that has seen simulated presses of it alone."""

from __future__ import annotations

from benchmarks.real_touch.photograph_sets import PhotographSet
from pipeline.kernels.touch.calibration_fit import FitOptions, fit_calibration
from pipeline.kernels.touch.sensor import Sensor

THICKNESS = 4e-3
"""m, assumed of the gel: it limits how deep a press can be, and no photograph tells it."""


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
    fitted, optics = fit_calibration(sensor, photographs.balls, photographs.untouched, 1e-3 * photographs.ball_radius, FitOptions(3, 1, 3))
    optics = optics.model_copy(update={"background": photographs.untouched_path.name})
    return fitted.model_copy(update={"calibrated": optics, "photograph": photographs.untouched_path.read_bytes()})

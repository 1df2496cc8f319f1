"""Our method: a sensor calibrated with photographs of balls, and a network trained only on simulated presses of it."""

from __future__ import annotations

from benchmarks.real_touch.photograph_sets import PhotographSet
from pipeline.kernels.touch.colour_fit import FIT_FOR_DEPTH, fit_colours
from pipeline.kernels.touch.sensor import Sensor

THICKNESS = 4e-3
"""m, assumed thickness of the gel: it limits the depth of a press, and photographs do not show it."""


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
    fit = fit_colours(sensor, photographs.balls, photographs.untouched, 1e-3 * photographs.ball_radius, FIT_FOR_DEPTH)
    optics = fit.calibration.model_copy(update={"background": photographs.untouched_path.name})
    print(f"{photographs.name}: degree {fit.position_degree} in the position, gel {fit.sensor.gel}", flush=True)
    return fit.sensor.model_copy(update={"calibrated": optics, "photograph": photographs.untouched_path.read_bytes()})

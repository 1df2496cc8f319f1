"""Our method: a sensor calibrated with photographs of balls, and a network trained only on simulated presses of it."""

from benchmarks.real_touch.photograph_sets import PhotographSet
from pipeline.contrib.calibration.calibrate_sensor import uncalibrated_sensor
from pipeline.contrib.calibration.colour_fit import FIT_FOR_DEPTH, fit_colours
from pipeline.kernels.touch.sensor import Sensor

THICKNESS = 4e-3
"""m, assumed thickness of the gel: it limits the depth of a press, and photographs do not show it."""


def calibrated_sensor(photographs: PhotographSet) -> Sensor:
    """Calibrate a sensor as `calibrate-sensor` does, with all balls of a set."""
    pitch = 1e-3 * photographs.mm_per_pixel
    sensor = uncalibrated_sensor(photographs.name, photographs.untouched.shape[:2], pitch=pitch, thickness=THICKNESS)
    fit = fit_colours(sensor, photographs.balls, photographs.untouched, 1e-3 * photographs.ball_radius, FIT_FOR_DEPTH)
    optics = fit.calibration.model_copy(update={"background": photographs.untouched_path.name})
    print(f"{photographs.name}: degree {fit.position_degree} in the position, gel {fit.sensor.gel}", flush=True)
    return fit.sensor.model_copy(update={"calibrated": optics, "photograph": photographs.untouched.tobytes()})

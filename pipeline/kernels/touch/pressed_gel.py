"""The gel that an object is pressed into: elastic, or with a membrane that the contact pulls in, less with distance."""

import math

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.depth_maps import impression
from pipeline.kernels.touch.elastic_contact import PressedGel, press_elastic
from pipeline.kernels.touch.sensor import Sensor

PASSES = 2  # passes of the exponential filter along each axis: with two its response is nearly round


def membrane_indentation(pressed: Array, sigma: tuple[float, float]) -> Array:  # (rows, cols) m
    """Compute the indentation of the membrane in and around a contact: the larger of D' and of D' smoothed.

    Smoothing, of a standard deviation along y and x, pixels, is a recursive two-sided exponential filter, `PASSES` times along each axis;
    the gel is flat beyond the image.
    """
    decay_y, decay_x = (math.exp(-math.sqrt(2 * PASSES) / pixels) for pixels in sigma)
    smooth = pressed.T.copy()
    for decay in (decay_x, decay_y) * PASSES:
        _smooth_columns(smooth, decay)
        smooth = np.ascontiguousarray(smooth.T)
    return np.maximum(pressed, smooth.T)


@compiled
def _smooth_columns(image: Array, decay: float) -> None:
    rows, cols = image.shape
    gain = (1 - decay) / (1 + decay)
    forward, carried = np.empty((rows, cols)), np.zeros(cols)
    for row in range(rows):
        line, into = image[row], forward[row]
        for col in range(cols):
            carried[col] = line[col] + decay * carried[col]
            into[col] = carried[col]
    carried[:] = 0.0
    for back in range(rows):
        line, into = image[rows - 1 - back], forward[rows - 1 - back]
        for col in range(cols):
            ahead = decay * carried[col]
            carried[col] = line[col] + ahead
            line[col] = gain * (into[col] + ahead)


def press_gel(depth: np.ndarray, sensor: Sensor) -> PressedGel:
    """Compute the state of a gel under an object at a depth D (rows, cols), m; without layer or membrane it gives way only there."""
    return gel_under(impression(depth, sensor), sensor)


def gel_under(pressed: Array, sensor: Sensor) -> PressedGel:
    """Compute the state of a gel under an impression (rows, cols), m; otherwise as `press_gel`."""
    if sensor.gel is not None:
        return press_elastic(pressed, sensor, sensor.gel)
    indentation = pressed
    if sensor.membrane > 0 and pressed.any():
        indentation = membrane_indentation(pressed, (sensor.membrane / sensor.pitch[0], sensor.membrane / sensor.pitch[1]))
    return PressedGel(indentation, (pressed > 0) & (indentation <= pressed))


def normal_force(pressure: Array, sensor: Sensor) -> float:
    """Add up the pressure (rows, cols), Pa, on a sensor's gel: the normal force, N."""
    return float(pressure.sum()) * sensor.pitch[0] * sensor.pitch[1]


def scaled_gel(sensor: Sensor, factor: float) -> Sensor:
    """Multiply the width of a sensor's membrane, or the thickness of its elastic gel, by a factor."""
    if sensor.gel is None:
        return sensor.model_copy(update={"membrane": sensor.membrane * factor})
    return sensor.model_copy(update={"gel": sensor.gel.model_copy(update={"thickness": sensor.layer_thickness * factor})})

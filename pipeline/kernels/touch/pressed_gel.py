"""The gel that an object is pressed into: elastic, or with a membrane that the contact pulls in, less with distance."""

import math
from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.depth_maps import impression
from pipeline.kernels.touch.elastic_contact import press_elastic
from pipeline.kernels.touch.sensor import Sensor

PASSES = 2  # passes of the exponential filter along each axis: with two its response is nearly round


def membrane_indentation(pressed: Array, sigma: tuple[float, float]) -> Array:  # (rows, cols) m
    """Compute the indentation of the membrane in and around a contact: the larger of D' and of D' smoothed.

    Smoothing, of a standard deviation along y and x, pixels, is a recursive two-sided exponential filter, `PASSES` times along each axis;
    the gel is flat beyond the image.
    """
    smooth = np.ascontiguousarray(pressed).copy()
    decays = [math.exp(-math.sqrt(2 * PASSES) / pixels) for pixels in sigma]
    for _ in range(PASSES):
        _smooth_along_rows(smooth, decays[1])
        _smooth_along_columns(smooth, decays[0])
    return np.maximum(pressed, smooth)


@compiled
def _smooth_along_rows(image: Array, decay: float) -> None:
    rows, cols = image.shape
    gain = (1 - decay) / (1 + decay)
    forward = np.empty(cols)
    for row in range(rows):
        line, carried = image[row], 0.0
        for col in range(cols):
            carried = line[col] + decay * carried
            forward[col] = carried
        carried = 0.0
        for back in range(cols):
            col = cols - 1 - back
            ahead = decay * carried
            carried = line[col] + ahead
            line[col] = gain * (forward[col] + ahead)


@compiled
def _smooth_along_columns(image: Array, decay: float) -> None:
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


class PressedGel(NamedTuple):
    """The surface of a gel, and where an object touches it."""

    indentation: Array  # (rows, cols) m: how deep it lies below its rest; negative where it rises
    contact: Mask  # (rows, cols) where the object touches it
    pressure: Array | None = None  # (rows, cols) Pa, of an elastic gel; else None


def press_gel(depth: np.ndarray, sensor: Sensor) -> PressedGel:
    """Compute the state of a gel under an object at a depth D (rows, cols), m; without layer or membrane it gives way only there."""
    return gel_under(impression(depth, sensor), sensor)


def gel_under(pressed: Array, sensor: Sensor) -> PressedGel:
    """Compute the state of a gel under an impression (rows, cols), m; otherwise as `press_gel`."""
    if sensor.gel is not None:
        indentation, pressure = press_elastic(pressed, sensor, sensor.gel)
        return PressedGel(indentation, pressure > 0, pressure)
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

"""The gel that an object is pressed into: its surface, and where the object touches it."""

from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.touch.elastic_contact import press_elastic
from pipeline.kernels.touch.gel_membrane import membrane_indentation
from pipeline.kernels.touch.gel_surface import impression
from pipeline.kernels.touch.sensor import Sensor


class PressedGel(NamedTuple):
    """The surface of a gel, and where an object touches it."""

    indentation: Array  # (rows, cols) m: how deep it lies below its rest; negative where it rises
    contact: Mask  # (rows, cols) where the object touches it
    pressure: Array | None = None  # (rows, cols) Pa, of an elastic gel; else None


def press_gel(
    depth: np.ndarray,  # (rows, cols) D from the sensor plane, m; float32 or float64, +inf where nothing is met
    sensor: Sensor,  # whose gel is elastic, or has a membrane; a gel with neither is indented only under the object
) -> PressedGel:
    """Compute the state of a gel under an object."""
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

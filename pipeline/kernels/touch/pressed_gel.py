"""The gel that an object is pressed into: its surface, and where the object touches it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.calibrated_shading import deformed
from pipeline.kernels.touch.gel_surface import impression
from pipeline.kernels.touch.sensor import Sensor


class PressedGel(NamedTuple):
    """Hold the state of a gel.

    Attributes
    ----------
    indentation
        (rows, cols) float64, m: how deep the gel's surface lies below its rest.
    contact
        (rows, cols): where the object touches it.
    """

    indentation: NDArray[np.float64]
    contact: NDArray[np.bool_]


def press_gel(depth: np.ndarray, sensor: Sensor) -> PressedGel:
    """Compute the state of a gel under an object.

    Parameters
    ----------
    depth
        (rows, cols) D of the object in m from the sensor plane, float32 or float64, +inf where nothing is met.
    sensor
        Gives the gel; one without a membrane is drawn in nowhere but under the object.

    Returns
    -------
    Surface and contact.

    Raises
    ------
    ValueError
        As `impression`.
    """
    pressed = impression(depth, sensor)
    indentation = deformed(pressed, sensor)
    return PressedGel(indentation, (pressed > 0) & (indentation <= pressed))

"""The tactile image: three lamps shine on the impression in the gel, equations 1 to 5.

Valid range: sensors of any size from 10 µm to 10 m, lamps at any position above the sensor plane, depths from 0 to +inf.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.sensor import Sensor

WHITE = 255
"""The uint8 value of intensity 1."""


def impression(depth: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """Compute the impression D' of an object in the gel.

    Parameters
    ----------
    depth
        (rows, cols) D in m from the sensor plane, float32 or float64, +inf where nothing is met.
    sensor
        Gives the shape and w.

    Returns
    -------
    (rows, cols) float64, m; 0 where the gel is not pressed in.

    Raises
    ------
    ValueError
        `depth` holds NaN or negative values, or has another shape.

    Notes
    -----
    D' = ReLU(w - D), equation 1.
    """
    if depth.shape != sensor.shape:
        raise ValueError(f"depth has shape {depth.shape}; sensor {sensor.name!r} has {sensor.shape} (rows, cols)")
    if not (depth >= 0).all():
        raise ValueError("depth holds NaN or negative values; it must be 0 or more, and +inf where nothing is met")
    return np.maximum(sensor.w - depth.astype(np.float64), 0.0)


def tactile_image(depth: np.ndarray, sensor: Sensor) -> NDArray[np.uint8]:
    """Compute the tactile image R of a depth map (equations 1 to 5).

    Parameters
    ----------
    depth
        (rows, cols) D in m from the sensor plane, float32 or float64, +inf where nothing is met.
    sensor
        Gives width, w, lamps and lambda.

    Returns
    -------
    (rows, cols, 3) uint8, red, green, blue: intensity 0..1, clipped, times 255, rounded to the nearest.

    Raises
    ------
    ValueError
        As `impression`.

    Notes
    -----
    All lengths are sensor widths: x = (col + ½)/cols, y = (row + ½)/rows, z = D'/width. Derivatives are central differences, one-sided
    at the rim. A lamp does not light a point of the surface at its own position. Depth in float32 instead of float64 moves an
    intensity by at most 2^-23 lambda w/width times the pixels per side, 5e-6 for the shipped sensor: few values change, none by more
    than 1.
    """
    z = impression(depth, sensor) / sensor.width
    slope_y, slope_x = (change * count for change, count in zip(np.gradient(z), sensor.shape, strict=True))
    steepness = slope_x * slope_x + slope_y * slope_y + 1.0  # |n|²
    x = (np.arange(sensor.cols) + 0.5) / sensor.cols
    y = ((np.arange(sensor.rows) + 0.5) / sensor.rows)[:, None]
    image = np.empty((*sensor.shape, 3), np.uint8)
    for channel, (lamp_x, lamp_y, lamp_z) in enumerate((sensor.lights.red, sensor.lights.green, sensor.lights.blue)):
        to_x, to_y, to_z = lamp_x - x, lamp_y - y, lamp_z - z
        dot = to_z - slope_x * to_x - slope_y * to_y  # n · (P - S)
        squared = to_x * to_x + to_y * to_y + to_z * to_z
        squared[squared == 0] = 1  # the lamp is at a point of the surface, where `dot` is 0
        dot *= sensor.diffuse / np.sqrt(steepness * squared)
        image[..., channel] = np.rint(np.clip(dot, 0.0, 1.0) * WHITE)
    return image


def untouched_image(sensor: Sensor) -> NDArray[np.uint8]:
    """Compute the tactile image of a sensor that nothing touches.

    Parameters
    ----------
    sensor
        Gives the shape, lamps and lambda.

    Returns
    -------
    (rows, cols, 3) uint8, red, green, blue.
    """
    return tactile_image(np.full(sensor.shape, np.inf), sensor)

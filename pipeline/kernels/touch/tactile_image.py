"""The tactile image: the view of a sensor's camera of the impression in the gel.

Valid range: sensors of any size from 10 µm to 10 m, lamps at any position above the sensor plane, depths from 0 to +inf.
"""

import io
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.calibrated_shading import indentation_change, polynomial_background
from pipeline.kernels.touch.gel_surface import gel_surface
from pipeline.kernels.touch.lamp_shading import WHITE, shade
from pipeline.kernels.touch.optics import Calibration, Lights
from pipeline.kernels.touch.pressed_gel import press_gel
from pipeline.kernels.touch.sensor import Sensor


def tactile_image(
    depth: np.ndarray,  # (rows, cols) D from the sensor plane, m; float32 or float64, +inf where nothing is met
    sensor: Sensor,
    rng: np.random.Generator | None = None,  # draws the pixel noise of a sensor that has some; None for no noise
) -> NDArray[np.uint8]:  # (rows, cols, 3) red, green, blue
    """Compute the tactile image R of a depth map: equations 1 to 5, or the colours that were fitted to photographs.

    Intensities are clipped to 0..1, multiplied by 255, and rounded to the nearest.

    With lamps, all lengths are sensor widths: x = (col + ½)/cols, y = (row + ½)/rows · height/width, z = D'/width. Derivatives are
    central differences, one-sided at the rim. A lamp does not light a point of the surface at its own position. Depth in float32
    instead of float64 moves an intensity by at most 2^-23 lambda w/width times the pixels per side, 5e-6 for the shipped sensor: few
    values change, none by more than 1.
    """
    return image_of_gel(press_gel(depth, sensor).indentation, sensor, rng)


def image_of_gel(
    indentation: Array,  # (rows, cols) m: how deep the surface lies below its rest, from `press_gel`
    sensor: Sensor,
    rng: np.random.Generator | None = None,  # as in `tactile_image`
) -> NDArray[np.uint8]:  # (rows, cols, 3) red, green, blue
    """Compute the tactile image of a gel whose surface is known."""
    if sensor.calibrated is None:
        image: NDArray[Any] = _lamp_image(indentation, sensor)
    else:
        image = background(sensor, sensor.calibrated) + indentation_change(indentation, sensor, sensor.calibrated)
    if rng is not None and sensor.noise != "none":
        image = image + rng.normal(0.0, sensor.noise, image.shape)
    return image if image.dtype == np.uint8 else _levels(image)


def _levels(image: Array) -> NDArray[np.uint8]:
    levels = np.empty(image.shape, np.uint8)
    _round(np.ascontiguousarray(image).reshape(-1), levels.reshape(-1))
    return levels


@compiled
def _round(image: Array, levels: NDArray[np.uint8]) -> None:
    for i in range(len(image)):
        levels[i] = np.uint8(np.rint(min(max(image[i], 0.0), float(WHITE))))


def untouched_image(sensor: Sensor) -> NDArray[np.uint8]:  # (rows, cols, 3) red, green, blue
    """Compute the tactile image of a sensor that nothing touches, without noise."""
    return tactile_image(np.full(sensor.shape, np.inf), sensor)


def background(sensor: Sensor, calibration: Calibration) -> Array:  # (rows, cols, 3) levels
    """Read or compute the untouched image of a calibrated sensor; do not change it."""
    if not isinstance(calibration.background, str):
        return polynomial_background(sensor, calibration.background)
    if sensor.photograph is None:
        raise ValueError(f"the background of sensor {sensor.name!r} is {calibration.background}, which was not loaded; use load_sensor")
    image = _decoded(sensor.photograph)
    if image.shape != (*sensor.shape, 3):
        raise ValueError(f"{calibration.background} has the shape {image.shape}; sensor {sensor.name!r} needs {(*sensor.shape, 3)}")
    return image


@lru_cache(maxsize=8)
def _decoded(photograph: bytes) -> Array:
    return np.asarray(Image.open(io.BytesIO(photograph)).convert("RGB"), np.float64)


def _lamp_image(bump: Array, sensor: Sensor) -> NDArray[np.uint8]:
    """Shade the indented pixels by equations 2 to 5; elsewhere keep the untouched image."""
    rest, image = _resting_surface(sensor)
    image = image.copy()
    _shade(rest + bump / sensor.width if rest.any() else bump / sensor.width, rest, sensor, image)
    return image


@lru_cache(maxsize=8)
def _resting_surface(sensor: Sensor) -> tuple[Array, NDArray[np.uint8]]:  # (rows, cols), (rows, cols, 3)
    """Compute the surface at rest, below w in sensor widths, and its image."""
    rest = np.broadcast_to((sensor.w - gel_surface(sensor)) / sensor.width, sensor.shape).copy()
    image = np.zeros((*sensor.shape, 3), np.uint8)
    _shade(rest, np.full(sensor.shape, np.nan), sensor, image)  # NaN equals no height: every pixel is shaded
    return rest, image


def _shade(z: Array, rest: Array, sensor: Sensor, image: NDArray[np.uint8]) -> None:
    lights = sensor.lights
    assert isinstance(lights, Lights)
    shade(z, rest, sensor.aspect, sensor.diffuse, np.array([lights.red, lights.green, lights.blue]), image)

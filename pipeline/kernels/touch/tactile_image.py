"""Equations 2 to 5 per pixel, compiled: from the impression to the intensities of three lamps."""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import WHITE, Array
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.calibrated_shading import indentation_change, polynomial_background
from pipeline.kernels.touch.depth_maps import gel_surface, press_gel
from pipeline.kernels.touch.sensor import Calibration, Lights, Sensor


@compiled
def shade(
    z: Array,  # (rows, cols) contiguous, the gel's surface in sensor widths, growing towards the camera
    rest: Array,  # (rows, cols) the same where nothing presses
    aspect: float,  # height of the sensor plane over its width
    diffuse: float,  # lambda of equation 2
    lamps: Array,  # (3, 3) positions of the red, green and blue lamp, sensor widths
    image: NDArray[np.uint8],  # (rows, cols, 3) holds the untouched image; changed in place
) -> None:
    """Shade the pixels where the gel is not at rest, and leave those that are at rest with their neighbours."""
    rows, cols = z.shape
    slope_x, slope_y, light = np.empty(cols), np.empty(cols), np.empty(cols)
    for row in range(rows):
        before, after = max(row - 1, 0), min(row + 1, rows - 1)
        above, below, rise = z[before], z[after], after - before
        first, last = _moved(z[before : after + 1], rest[before : after + 1])
        if first > last:
            continue
        for col in range(first, last + 1):
            left, right = max(col - 1, 0), min(col + 1, cols - 1)
            slope_x[col] = (z[row, right] - z[row, left]) / (right - left) * cols
        heights, upper, lower = z[row, first : last + 1], above[first : last + 1], below[first : last + 1]
        slopes_x, slopes_y, lights = slope_x[first : last + 1], slope_y[first : last + 1], light[first : last + 1]
        for i in range(len(heights)):
            slopes_y[i] = (lower[i] - upper[i]) / rise * rows / aspect
        for channel in range(3):
            to_y = lamps[channel, 1] - (row + 0.5) / rows * aspect
            for i in range(len(heights)):  # slices from 0 on: the compiler vectorises this loop
                to_x, to_z = lamps[channel, 0] - (first + i + 0.5) / cols, lamps[channel, 2] - heights[i]
                steepness = slopes_x[i] * slopes_x[i] + slopes_y[i] * slopes_y[i] + 1.0  # |n|²
                squared = to_x * to_x + to_y * to_y + to_z * to_z
                squared = 1.0 if squared == 0 else squared  # the lamp is at a point of the surface, which it does not light
                dot = to_z - slopes_x[i] * to_x - slopes_y[i] * to_y  # n · (P - S)
                lights[i] = dot * (diffuse / math.sqrt(steepness * squared))
            for i in range(len(heights)):
                image[row, first + i, channel] = np.uint8(np.rint(min(max(lights[i], 0.0), 1.0) * WHITE))


@compiled
def _moved(z: Array, rest: Array) -> tuple[int, int]:
    """Find the first and last column where any of two or three rows, or a neighbour, is not at rest; first > last if all are."""
    lines, cols = z.shape
    first, last = cols, -1
    for line in range(lines):
        left, right = 0, cols - 1
        while left < first and z[line, left] == rest[line, left]:
            left += 1
        while right > last and z[line, right] == rest[line, right]:
            right -= 1
        first, last = min(first, left), max(last, right)
    return max(first - 1, 0), (min(last + 1, cols - 1) if last >= first else -1)


def tactile_image(
    depth: np.ndarray,  # (rows, cols) D from the sensor plane, m; float32 or float64, +inf where nothing is met
    sensor: Sensor,
    rng: np.random.Generator | None = None,  # draws the pixel noise of a sensor that has some; None for no noise
) -> NDArray[np.uint8]:  # (rows, cols, 3) red, green, blue
    """Compute the tactile image R of a depth map: equations 1 to 5, or the colours that were fitted to photographs.

    Intensities are clipped to 0..1, multiplied by 255, and rounded to the nearest. With lamps, all lengths are sensor widths:
    x = (col + ½)/cols, y = (row + ½)/rows · height/width, z = D'/width. Derivatives are central differences, one-sided at the rim. Depth
    in float32 instead of float64 moves an intensity by at most 2^-23 lambda w/width times the pixels per side, no value by more than 1.
    """
    return render_gel(press_gel(depth, sensor).indentation, sensor, rng)


def render_gel(indentation: Array, sensor: Sensor, rng: np.random.Generator | None = None) -> NDArray[np.uint8]:
    """Compute the tactile image (rows, cols, 3) of a gel that lies below its rest by an indentation (rows, cols), m."""
    if sensor.calibrated is None:
        rest, untouched = _resting_surface(sensor)
        image: NDArray[Any] = untouched.copy()  # pixels at rest stay as they are
        z = indentation / sensor.width
        _shade(rest + z if rest.any() else z, rest, sensor, image)
    else:
        image = indentation_change(indentation, sensor, sensor.calibrated, background(sensor, sensor.calibrated).copy())
    if rng is not None and sensor.noise != "none":
        image = image + rng.normal(0.0, sensor.noise, image.shape)
    return image if image.dtype == np.uint8 else _levels(np.ascontiguousarray(image))


@compiled
def _levels(image: Array) -> NDArray[np.uint8]:
    levels, values = np.empty(image.size, np.uint8), image.reshape(-1)
    for i in range(len(values)):
        value = values[i] if values[i] > 0 else 0.0
        levels[i] = np.uint8(np.rint(value if value < WHITE else float(WHITE)))
    return levels.reshape(image.shape)


def untouched_image(sensor: Sensor) -> NDArray[np.uint8]:  # (rows, cols, 3) red, green, blue
    """Compute the tactile image of a sensor that nothing touches, without noise."""
    return tactile_image(np.full(sensor.shape, np.inf), sensor)


def background(sensor: Sensor, calibration: Calibration) -> Array:  # (rows, cols, 3) levels
    """Read or compute the untouched image of a calibrated sensor; do not change it."""
    if not isinstance(calibration.background, str):
        return polynomial_background(sensor, calibration.background)
    if sensor.photograph is None:
        raise ValueError(f"the background of sensor {sensor.name!r} is {calibration.background}, which was not loaded; use load_sensor")
    if len(sensor.photograph) != 3 * sensor.rows * sensor.cols:
        raise ValueError(f"{calibration.background} has {len(sensor.photograph)} bytes; sensor {sensor.name!r} needs {(*sensor.shape, 3)}")
    return _as_levels(sensor.photograph, sensor.shape)


@lru_cache(maxsize=8)
def _as_levels(pixels: bytes, shape: tuple[int, int]) -> Array:
    return np.frombuffer(pixels, np.uint8).reshape(*shape, 3).astype(np.float64)


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

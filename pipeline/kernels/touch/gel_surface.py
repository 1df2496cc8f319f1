"""The undeformed surface of a gel: flat, curved, or a height map; and the impression in it."""

from functools import lru_cache

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.touch.sensor import Sensor, pixel_centres


@lru_cache(maxsize=16)
def gel_surface(sensor: Sensor) -> Array:  # (rows, cols) m, read-only; () where the gel is flat, w
    """Compute the height of the undeformed gel above the sensor plane."""
    if sensor.surface is None:
        return np.array(sensor.w)
    x, y = pixel_centres(sensor)
    if sensor.surface.radius is not None:
        across = {"both": x[None] ** 2 + y[:, None] ** 2, "x": x[None] ** 2 + 0 * y[:, None], "y": 0 * x[None] + y[:, None] ** 2}
        radius = sensor.surface.radius
        surface = sensor.w - (radius - np.sqrt(radius**2 - across[sensor.surface.along]))
    else:
        heights = np.array(sensor.surface.heights)
        grid = [np.linspace(-side / 2, side / 2, count) for side, count in zip((sensor.height, sensor.width), heights.shape, strict=True)]
        surface = RegularGridInterpolator(grid, heights)(np.stack(np.meshgrid(y, x, indexing="ij"), axis=-1))
    surface.flags.writeable = False
    return np.asarray(surface)


@lru_cache(maxsize=16)
def gel_top(sensor: Sensor) -> float:
    """Compute the greatest height of the undeformed gel above the sensor plane, m: w, or more for a height map."""
    return max(sensor.w, float(gel_surface(sensor).max()))


def in_gel(depth: np.ndarray, sensor: Sensor) -> Mask:  # (..., rows, cols), as depth, m
    """Find the pixels where a surface lies in the gel: D < w; for shapes. `pressed_pixels` decides what touches."""
    return np.asarray(depth < gel_surface(sensor))


def impression(
    depth: np.ndarray,  # (rows, cols) D from the sensor plane, m; float32 or float64, +inf where nothing is met
    sensor: Sensor,
) -> Array:  # (rows, cols) m; 0 where the gel is not pressed in
    """Compute the impression of an object in the gel, D' = ReLU(w - D), equation 1.

    Where the gel is curved, w is its height at the pixel.
    """
    if depth.shape != sensor.shape:
        raise ValueError(f"depth has shape {depth.shape}; sensor {sensor.name!r} has {sensor.shape} (rows, cols)")
    if not (depth >= 0).all():
        raise ValueError("depth holds NaN or negative values; it must be 0 or more, and +inf where nothing is met")
    return np.maximum(gel_surface(sensor) - depth.astype(np.float64, copy=False), 0.0)

"""Where each pixel's ray leaves the undeformed gel, one ray after the other."""

import math

import numpy as np

from pipeline.kernels.touch.sensor import Sensor


def gel_heights(sensor: Sensor) -> np.ndarray:
    """(rows, cols) heights of the undeformed gel over the pixels, m."""
    found = np.full(sensor.shape, sensor.w)
    for row, col in np.ndindex(sensor.shape) if sensor.surface is not None else ():
        x = ((col + 0.5) / sensor.cols - 0.5) * sensor.width
        y = ((row + 0.5) / sensor.rows - 0.5) * sensor.height
        found[row, col] = _leaves_bulge(x, y, sensor) if sensor.surface.radius is not None else _on_map(x, y, sensor)
    return found


def _leaves_bulge(x: float, y: float, sensor: Sensor) -> float:
    """Compute the greater root z of |(x, y, z) - centre|² = R²; a cylinder has no part of it along its axis."""
    start = np.array([x * (sensor.surface.along != "y"), y * (sensor.surface.along != "x"), 0.0])
    centre = np.array([0, 0, sensor.w - sensor.surface.radius])
    half_b, c = (start - centre)[2], (start - centre) @ (start - centre) - sensor.surface.radius**2
    return -half_b + math.sqrt(half_b**2 - c)


def _on_map(x: float, y: float, sensor: Sensor) -> float:
    """Compute the mean of the four heights around the point, weighted by the areas opposite to them."""
    heights = sensor.surface.heights
    down, across = (y / sensor.height + 0.5) * (len(heights) - 1), (x / sensor.width + 0.5) * (len(heights[0]) - 1)
    row, col = min(int(down), len(heights) - 2), min(int(across), len(heights[0]) - 2)
    v, u = down - row, across - col
    above, below = heights[row][col : col + 2], heights[row + 1][col : col + 2]
    return (1 - v) * ((1 - u) * above[0] + u * above[1]) + v * ((1 - u) * below[0] + u * below[1])

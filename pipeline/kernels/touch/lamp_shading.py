"""Equations 2 to 5 per pixel, compiled: from the impression to the intensities of three lamps."""

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled

WHITE = 255  # the uint8 value of intensity 1


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

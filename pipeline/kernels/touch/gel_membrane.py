"""The gel around a contact: a membrane that the contact pulls in, less with distance."""

import math

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled

PASSES = 2  # passes of the exponential filter along each axis: with two its response is nearly round


def membrane_indentation(
    pressed: Array,  # (rows, cols) the impression D', m
    sigma: tuple[float, float],  # standard deviation of the smoothing along y and x, pixels, > 0
) -> Array:  # (rows, cols) m
    """Compute the indentation of the membrane in and around a contact: the larger of D' and of D' smoothed.

    In the middle of a contact it is D', outside it decays. Smoothing is a recursive two-sided exponential filter,
    `PASSES` times along each axis; the gel is flat beyond the image.
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

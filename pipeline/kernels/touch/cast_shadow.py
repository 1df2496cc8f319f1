"""Shadows that bumps of the gel cast, by a sweep along the lamp's direction."""

import math

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled


def shade_depth(
    bump: Array,  # (rows, cols) height towards the camera, m; negative where an elastic gel rises
    pitch: tuple[float, float],  # size of a pixel along y and x, m
    *,
    direction: float,  # towards the lamp, rad from +x to +y
    slope: float,  # height over length of the lamp's rays, > 0
) -> Array:  # (rows, cols) m, >= 0: below the edge of the shade, along the height
    """Compute how deep each point of the gel lies in the shade of a distant lamp.

    The edge of the shade is carried from line to line towards the far side, a line per step, with linear interpolation within a line.
    Beyond the image the gel is at rest, at height 0.
    """
    step_y, step_x = math.sin(direction) / pitch[0], math.cos(direction) / pitch[1]  # pixels per m towards the lamp
    swapped = abs(step_x) > abs(step_y)
    image = np.ascontiguousarray(bump.T if swapped else bump)
    major, minor = (step_x, step_y) if swapped else (step_y, step_x)
    if major > 0:
        image = image[::-1].copy()
    shade = np.empty_like(image)
    _sweep(image, minor / abs(major), slope / abs(major), shade)
    if major > 0:
        shade = shade[::-1]
    return shade.T if swapped else shade


@compiled
def _sweep(image: Array, shift: float, drop: float, shade: Array) -> None:
    """Sweep from line 0, nearest to the lamp; the line before lies `shift` pixels aside, rays fall `drop` per line."""
    lines, length = image.shape
    offset = math.floor(shift)
    share = shift - offset
    edge, padded = np.full(length, -drop), np.zeros(length + 4)
    for line in range(lines):
        row, out = image[line], shade[line]
        for i in range(length):
            out[i] = max(edge[i] - row[i], 0.0)
            padded[i + 2] = max(edge[i], row[i])
        near, far = padded[offset + 2 : offset + 2 + length], padded[offset + 3 : offset + 3 + length]
        for i in range(length):
            edge[i] = near[i] + share * (far[i] - near[i]) - drop

"""Quantise depth maps before compression."""

import numpy as np

from pipeline.kernels.arrays import Array, Array32
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.gel_surface import gel_top
from pipeline.kernels.touch.sensor import Sensor


def quantise_depth(
    depth: Array,  # (..., rows, cols) m, +inf where nothing is met
    sensor: Sensor,
    *,
    gel_bits: int | None,  # depths in the gel become multiples of 2^-gel_bits m; None keeps float32's precision
    far_bits: int | None,  # depths beyond it become multiples of 2^-far_bits m
) -> Array32:  # (..., rows, cols) m
    """Round depths to multiples of a power of two; digits beyond any use are noise that no codec can compress.

    The error is at most half a step and half a float32 unit in the last place. Depths beyond the gel's highest point
    stay beyond it: one that would be rounded into it becomes the least float32 beyond it; where a curved gel is lower,
    a depth beyond it may be rounded into it. +inf stays.
    """
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    rounded = np.empty(depth.shape, np.float32)
    gel_steps, far_steps = (0.0 if bits is None else 2.0**bits for bits in (gel_bits, far_bits))
    gel = gel_top(sensor)
    beyond = np.float32(gel)
    beyond = beyond if beyond >= gel else np.nextafter(beyond, np.float32(np.inf))
    _round(np.ascontiguousarray(depth).reshape(-1), gel, beyond, gel_steps, far_steps, rounded.reshape(-1))
    return rounded


@compiled
def _round(depth: Array, gel: float, beyond: np.float32, gel_steps: float, far_steps: float, rounded: Array32) -> None:
    """Round to multiples of 1/gel_steps below `gel` and of 1/far_steps beyond; 0 for not at all.

    Both are powers of two: scaling loses nothing. `beyond` is the least float32 that is not below `gel`.
    """
    for i in range(len(depth)):
        steps = gel_steps if depth[i] < gel else far_steps
        rounded[i] = depth[i] if steps == 0 else np.rint(depth[i] * steps) / steps
        if depth[i] >= gel > rounded[i]:  # a surface outside the gel stays outside
            rounded[i] = beyond

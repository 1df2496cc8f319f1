"""Quantise depth maps before compression."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.sensor import Sensor


def quantise_depth(depth: NDArray[np.float64], sensor: Sensor, *, gel_bits: int | None, far_bits: int | None) -> NDArray[np.float32]:
    """Round depths to multiples of a power of two; digits beyond any use are noise that no codec can compress.

    Parameters
    ----------
    depth
        (..., rows, cols) m, +inf where nothing is met.
    sensor
        Gives the thickness w of the gel.
    gel_bits, far_bits
        Depths in the gel become multiples of 2^-gel_bits m, depths beyond it of 2^-far_bits m; None keeps float32's precision.

    Returns
    -------
    (..., rows, cols) float32, m. The error is at most half a step and half a float32 unit in the last place; +inf stays.

    Raises
    ------
    ValueError
        `depth` holds NaN.
    """
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    in_gel, beyond = (depth if bits is None else np.ldexp(np.rint(np.ldexp(depth, bits)), -bits) for bits in (gel_bits, far_bits))
    return np.where(depth < sensor.w, in_gel, beyond).astype(np.float32)

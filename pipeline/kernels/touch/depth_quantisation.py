"""What of a depth map is worth its bytes: digits beyond any use are noise that no codec can shrink."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.sensor import Sensor


def quantise_depth(depth: NDArray[np.float64], sensor: Sensor, gel_bits: int | None, far_bits: int | None) -> NDArray[np.float32]:
    """Depths (..., rows, cols) in m as they are stored, float32: multiples of 2^-gel_bits m in the gel, of 2^-far_bits m beyond it.

    The error is at most half a step and half a float32 unit in the last place. None keeps what float32 holds; +inf stays.
    """
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    in_gel, beyond = (depth if bits is None else np.ldexp(np.rint(np.ldexp(depth, bits)), -bits) for bits in (gel_bits, far_bits))
    return np.where(depth < sensor.w, in_gel, beyond).astype(np.float32)

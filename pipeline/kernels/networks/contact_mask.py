"""Which pixels of a reading differ from the untouched one (supplement 2.2)."""

from __future__ import annotations

import math
from fractions import Fraction

import torch
from torch import Tensor

from pipeline.kernels.metrics.precision import FULL
from pipeline.kernels.networks.images import WHITE, check_intensities

THRESHOLD = 0.001
"""The supplement's: squared distance over colour, of images in [0, 1]."""


def contact_mask(readings: Tensor, untouched: Tensor, threshold: float = THRESHOLD) -> Tensor:
    """The positions of a sensor that interacted with the object: squared l2 norm over colour of the difference > threshold.

    Parameters
    ----------
    readings
        (..., H, W, 3), uint8, or float32 or float64 in [0, 1].
    untouched
        (H, W, 3) reading of the same sensor with nothing on it, of the same type and on the same device.
    threshold
        In squared intensities. The norm is squared: without the square, the quantisation of an image to 8 bits alone is
        beyond 0.001.

    Returns
    -------
    (..., H, W) bool.

    Notes
    -----
    uint8 differences are compared as integers with `threshold` times 255², hence without rounding; float32 ones may fall on either
    side of a threshold that is within 1e-6 of them.

    Raises
    ------
    ValueError
        Shapes or types that do not fit, half precision (its steps are as large as what is looked for), floats outside [0, 1] or
        NaN, or a threshold that is negative or no number.
    """
    if readings.ndim < 3 or untouched.ndim != 3 or readings.shape[-3:] != untouched.shape or untouched.shape[-1] != 3:
        raise ValueError(
            f"readings of shape {tuple(readings.shape)}, untouched {tuple(untouched.shape)}; they must be (..., H, W, 3) and (H, W, 3)"
        )
    if readings.dtype != untouched.dtype or readings.dtype not in (torch.uint8, *FULL):
        raise ValueError(f"readings are {readings.dtype}, untouched is {untouched.dtype}; both must be uint8, float32 or float64")
    if not 0 <= threshold < math.inf:
        raise ValueError(f"threshold {threshold} of a squared norm; it must be finite and at least 0")
    if readings.dtype == torch.uint8:
        difference = readings.to(torch.int32) - untouched.to(torch.int32)
        return difference.square().sum(dim=-1) > math.floor(Fraction(threshold) * WHITE**2)  # a float would be rounded
    for name, image in (("readings", readings), ("untouched", untouched)):
        check_intensities(name, image)
    return (readings - untouched).square().sum(dim=-1) > threshold

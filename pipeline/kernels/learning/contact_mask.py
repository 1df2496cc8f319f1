"""Which pixels of a reading differ from the untouched one (supplement 2.2)."""

from __future__ import annotations

import torch
from torch import Tensor

from pipeline.kernels.learning.images import WHITE

THRESHOLD = 0.001
"""The supplement's: squared distance over colour, of images in [0, 1]."""


def contact_mask(readings: Tensor, untouched: Tensor, threshold: float = THRESHOLD) -> Tensor:
    """The positions of a sensor that interacted with the object: squared l2 norm over colour of the difference > threshold.

    Parameters
    ----------
    readings
        (..., H, W, 3), uint8, or float in [0, 1].
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
    uint8 differences are compared as integers with `threshold` times 255², hence without rounding.
    """
    if readings.ndim < 3 or untouched.ndim != 3 or readings.shape[-3:] != untouched.shape or untouched.shape[-1] != 3:
        raise ValueError(
            f"readings of shape {tuple(readings.shape)}, untouched {tuple(untouched.shape)}; they must be (..., H, W, 3) and (H, W, 3)"
        )
    if readings.dtype != untouched.dtype or not (readings.dtype == torch.uint8 or readings.is_floating_point()):
        raise ValueError(f"readings are {readings.dtype}, untouched is {untouched.dtype}; both must be uint8, or both one floating type")
    if not threshold >= 0:
        raise ValueError(f"threshold {threshold} of a squared norm; it must be at least 0")
    if readings.dtype == torch.uint8:
        difference = readings.to(torch.int32) - untouched.to(torch.int32)
        return difference.square().sum(dim=-1) > threshold * WHITE**2
    for name, image in (("readings", readings), ("untouched", untouched)):
        if image.numel() and not (image.min() >= 0 and image.max() <= 1):
            raise ValueError(f"{name} reach from {image.min():g} to {image.max():g}; floating images must lie in [0, 1]: divide by {WHITE}")
    return (readings - untouched).square().sum(dim=-1) > threshold

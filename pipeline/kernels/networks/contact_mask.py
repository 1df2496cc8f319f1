"""Which pixels of a tactile image differ from the untouched one (supplement 2.2)."""

from __future__ import annotations

import math
from fractions import Fraction

import torch
from torch import Tensor

from pipeline.kernels.metrics.float_types import FULL_PRECISION
from pipeline.kernels.networks.image_tensors import WHITE, check_intensities

THRESHOLD = 0.001
"""The supplement's: squared distance over colour, of images in [0, 1]."""


def contact_mask(images: Tensor, untouched: Tensor, threshold: float = THRESHOLD) -> Tensor:
    """Find the pixels that touched: those whose squared l2 difference over colour exceeds the threshold.

    Parameters
    ----------
    images
        (..., H, W, 3) tactile images, uint8, or float32 or float64 in [0, 1].
    untouched
        (H, W, 3) tactile image of the same sensor with nothing on it, of the same type and on the same device.
    threshold
        In squared intensities.

    Returns
    -------
    (..., H, W) bool. uint8 differences are compared as integers, without rounding; float32 ones may fall on either side of a threshold
    that is within 1e-6 of them.

    Raises
    ------
    InvalidInput
        Floats leave [0, 1] or are NaN.
    ValueError
        Shapes or types do not fit, or the threshold is negative or no number.

    Notes
    -----
    The norm is squared: without the square, the quantisation to 8 bits alone exceeds the supplement's 0.001.
    """
    if images.ndim < 3 or untouched.ndim != 3 or images.shape[-3:] != untouched.shape or untouched.shape[-1] != 3:
        raise ValueError(
            f"images of shape {tuple(images.shape)}, untouched {tuple(untouched.shape)}; they must be (..., H, W, 3) and (H, W, 3)"
        )
    if images.dtype != untouched.dtype or images.dtype not in (torch.uint8, *FULL_PRECISION):
        raise ValueError(f"images are {images.dtype}, untouched is {untouched.dtype}; both must be uint8, float32 or float64")
    if not 0 <= threshold < math.inf:
        raise ValueError(f"threshold {threshold} of a squared norm; it must be finite and at least 0")
    if images.dtype == torch.uint8:
        difference = images.to(torch.int32) - untouched.to(torch.int32)
        return difference.square().sum(dim=-1) > math.floor(Fraction(threshold) * WHITE**2)  # a float would be rounded
    for name, image in (("images", images), ("untouched", untouched)):
        check_intensities(name, image)
    return (images - untouched).square().sum(dim=-1) > threshold

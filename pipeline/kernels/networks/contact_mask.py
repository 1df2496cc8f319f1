"""Contact masks: the pixels of a tactile image that differ from the untouched image (supplement 2.2)."""

import math
from fractions import Fraction

import torch
from torch import Tensor

from pipeline.kernels.tensor_checks import COLOURS, WHITE

THRESHOLD = 0.001  # the supplement's: squared distance over colour, of images in [0, 1]


def contact_mask(
    images: Tensor,  # (..., H, W, 3) uint8
    untouched: Tensor,  # (H, W, 3) uint8 image of the same sensor with nothing on it, on the same device
    threshold: float = THRESHOLD,  # in squared intensities
) -> Tensor:  # (..., H, W) bool
    """Find the pixels that touched: those whose squared l2 difference over colour exceeds the threshold.

    Differences are compared as integers, without rounding. The norm is squared: without the square, the quantisation to
    8 bits alone exceeds the supplement's 0.001.
    """
    if images.ndim < 3 or untouched.ndim != 3 or images.shape[-3:] != untouched.shape or untouched.shape[-1] != COLOURS:
        raise ValueError(
            f"images of shape {tuple(images.shape)}, untouched {tuple(untouched.shape)}; they must be (..., H, W, 3) and (H, W, 3)"
        )
    if images.dtype != torch.uint8 or untouched.dtype != torch.uint8:
        raise ValueError(
            f"images are {images.dtype}, untouched is {untouched.dtype}; tactile images are compared as they are stored, uint8"
        )
    if not 0 <= threshold <= COLOURS:
        raise ValueError(f"threshold {threshold}; it must be between 0 and {COLOURS}, the squared distance of black and white")
    difference = images.to(torch.int32) - untouched.to(torch.int32)
    return difference.square().sum(dim=-1) > math.floor(Fraction(threshold) * WHITE**2)  # a float would be rounded

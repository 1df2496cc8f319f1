"""Checks of tensors, and conversion of stored images to network input."""

from __future__ import annotations

import torch
from torch import Tensor

from pipeline.errors import InvalidInput

COLOURS = 3
WHITE = 255
"""The uint8 value of intensity 1."""


def network_input(images: Tensor, dtype: torch.dtype) -> Tensor:
    """Convert stored images to a network's input.

    Parameters
    ----------
    images
        (B, H, W, 3) uint8.
    dtype
        Of the network's parameters.

    Returns
    -------
    (B, 3, H, W) in [0, 1]; channels stay last in memory, which convolutions on a CPU are fastest with.

    Raises
    ------
    ValueError
        Other shapes or types.
    """
    if images.dtype != torch.uint8 or images.ndim != 4 or images.shape[3] != COLOURS:
        raise ValueError(f"images are {tuple(images.shape)} {images.dtype}; stored images are (B, H, W, {COLOURS}) uint8")
    return images.permute(0, 3, 1, 2).to(dtype) / WHITE


def check_intensities(name: str, images: Tensor) -> None:
    """Refuse images whose values leave [0, 1], such as images that were not divided by 255.

    Parameters
    ----------
    name
        Of the images in the message.
    images
        Any shape, floating.

    Raises
    ------
    InvalidInput
        A value is NaN, below 0 or above 1.
    """
    if not bool(((images >= 0) & (images <= 1)).all()):  # NaN is neither
        low, high = images.detach().aminmax()
        raise InvalidInput(f"{name} reach from {low:g} to {high:g}; floating images must lie in [0, 1]: divide by {WHITE}")


def check_full_precision(name: str, values: Tensor) -> None:
    """Refuse half precision and integers: at the scene's 0.6 m, bfloat16 goes in steps of 4 mm and float16 of 0.5 mm.

    Parameters
    ----------
    name
        Of the values in the message.
    values
        Any shape.

    Raises
    ------
    ValueError
        `values` is neither float32 nor float64.
    """
    if values.dtype not in (torch.float32, torch.float64):
        raise ValueError(
            f"{name} of type {values.dtype}: geometry takes the floating types float32 and float64; "
            "for half precision run a network under torch.autocast"
        )

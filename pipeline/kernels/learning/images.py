"""Stored images as networks take them."""

from __future__ import annotations

import torch
from torch import Tensor

WHITE = 255
"""The uint8 value of intensity 1."""


def network_input(images: Tensor, dtype: torch.dtype) -> Tensor:
    """(B, 3, H, W) in [0, 1] of images (B, H, W, 3) uint8; channels stay last in memory."""
    return images.permute(0, 3, 1, 2).to(dtype) / WHITE

"""Images at the ends of what a camera or a gel can show."""

from __future__ import annotations

import torch
from torch import Tensor

from pipeline.kernels.arrays import WHITE
from pipeline.kernels.tensor_checks import network_input

IMAGES = {
    "black": lambda size: torch.zeros(size, size, 3),
    "white": lambda size: torch.ones(size, size, 3),
    "one colour saturated": lambda size: torch.tensor([1.0, 0.0, 0.0]).expand(size, size, 3),
    "chequered": lambda size: (torch.arange(size)[:, None, None] + torch.arange(size)[:, None]).remainder(2).expand(size, size, 3).float(),
    "one white pixel": lambda size: (torch.arange(size * size) == size * size // 2).reshape(size, size, 1).expand(size, size, 3).float(),
    "noise": lambda size: torch.rand(size, size, 3, generator=torch.Generator().manual_seed(0)).mul(WHITE).round() / WHITE,
}
"""By name: a square image, pixels per side given, floats in [0, 1]."""
KINDS = sorted(IMAGES)


def stored(kind: str, size: int) -> Tensor:
    """(size, size, 3) uint8."""
    return (IMAGES[kind](size) * WHITE).round().to(torch.uint8)


def network_images(kind: str, size: int, batch: int = 1) -> Tensor:
    """(batch, 3, size, size) as a network takes it."""
    return network_input(stored(kind, size).expand(batch, -1, -1, -1), torch.float32)

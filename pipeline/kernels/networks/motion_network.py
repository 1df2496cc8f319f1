"""A small network that reads in two consecutive images of a gel how it is sheared, where it slips, and with which force it is pressed.

Printed dots show the shear; without them, little does.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, binary_cross_entropy_with_logits, l1_loss

from pipeline.kernels.tensors import COLOURS

CELL = 4  # pixels per side of the cells that it reads
SCALE = 50.0  # levels of 255 that are scaled to 1: the usual change of colours in a contact
FORCE_SCALE = 1e-2  # N that a cell's output of 1 adds to the force
SHEAR, SLIPS, FORCE = 10.0, 0.3, 0.5  # weights of the losses: shear, mm; slip; force, N


class GelMotion(NamedTuple):
    """What a `MotionNetwork` reads, and what it learns from."""

    shear: Tensor  # (B, 2, h, w) mm, mean displacement of the surface in cells, along x and y
    slips: Tensor  # (B, h, w) logits of the share of a cell that slips, or this share
    force: Tensor  # (B, 3) N, on the gel, sensor frame


class MotionNetwork(nn.Module):
    """Convolutions to cells of 4 × 4 pixels, and between cells up to 7 away; forces add up over cells. 10,550 parameters."""

    def __init__(self, width: int = 16) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, stride, dilation in ((2 * COLOURS + 2, 2, 1), (width, 2, 1), (width, 1, 1), (width, 1, 2), (width, 1, 4)):
            layers += [nn.Conv2d(inputs, width, 3, stride, padding=dilation, dilation=dilation), nn.ReLU(inplace=True)]
        self.layers = nn.Sequential(*layers, nn.Conv2d(width, 6, 1))
        nn.Module.to(self, memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(
        self,
        change: Tensor,  # (B, 3, H, W) image minus untouched image, levels
        before: Tensor,  # (B, 3, H, W) the same of the image before
        position: Tensor,  # (B or 1, 2, H, W) of the pixels, as for a `LocalNetwork`
    ) -> GelMotion:
        """Read a batch of images."""
        pixels = torch.cat([change / SCALE, (change - before) / SCALE, position.expand(len(change), -1, -1, -1)], dim=1)
        read = self.layers(pixels.contiguous(memory_format=torch.channels_last))
        return GelMotion(read[:, :2], read[:, 2], FORCE_SCALE * read[:, 3:].sum(dim=(2, 3)))


def in_cells(maps: Tensor) -> Tensor:  # (..., h, w)
    """Average maps (..., H, W) over cells."""
    return avg_pool2d(maps, CELL, ceil_mode=True, count_include_pad=False)


def motion_loss(read: GelMotion, true: GelMotion) -> Tensor:
    """Compute the loss of a batch, a scalar."""
    slips = binary_cross_entropy_with_logits(read.slips, true.slips)
    return SHEAR * l1_loss(read.shear, true.shear) + SLIPS * slips + FORCE * l1_loss(read.force, true.force)

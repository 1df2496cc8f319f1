"""A small network that reads a tactile image pixel by pixel: slopes from colours, depth from slopes, contact from depth.

It sees a neighbourhood of 0.8 mm, so that it learns the meaning of colours and not the shapes of the training set.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from pipeline.kernels.networks.slope_integration import integrate_slopes, surface_slopes
from pipeline.kernels.tensor_checks import COLOURS

CHANGE_SCALE = 50.0  # levels of 255 that are scaled to 1 for the network: the usual change of colours in a contact
CONTACT_FEATURES = 8  # features of the layers that find the contact


class LocalShape(NamedTuple):
    """The output of a `LocalNetwork`."""

    slopes: Tensor  # (B, 2, H, W)
    depth: Tensor  # (B, H, W) of the gel's surface below its rest, mm
    contact: Tensor  # (B, H, W) logits


class LocalNetwork(nn.Module):
    """Convolutions of 3 × 3, 3 × 3 dilated by 2, and 1 × 1 twice give slopes; their integral is the depth.

    Depth alone does not tell contact, as the gel around an object is drawn in too: separate convolutions find it in depth and slopes.

    `width` counts the features of the hidden layers; 20 make 6,500 parameters, 26 kB.
    """

    def __init__(self, width: int = 20) -> None:
        super().__init__()
        if width < 1:
            raise ValueError(f"a local network of width {width}; it needs at least 1")
        self.width = width
        self.colours = nn.Sequential(
            *(nn.Conv2d(COLOURS + 2, width, 3, padding=1), nn.ReLU(inplace=True)),
            *(nn.Conv2d(width, width, 3, padding=2, dilation=2), nn.ReLU(inplace=True)),
            *(nn.Conv2d(width, width, 1), nn.ReLU(inplace=True)),
            nn.Conv2d(width, 2, 1),
        )
        hidden = CONTACT_FEATURES
        self.shape = nn.Sequential(
            *(nn.Conv2d(4, hidden, 3, padding=1), nn.ReLU(inplace=True)),
            *(nn.Conv2d(hidden, hidden, 3, padding=2, dilation=2), nn.ReLU(inplace=True)),
            *(nn.Conv2d(hidden, hidden, 3, padding=4, dilation=4), nn.ReLU(inplace=True)),
            nn.Conv2d(hidden, 1, 1),
        )
        nn.Module.to(self, memory_format=torch.channels_last)  # type: ignore[call-overload]  # on a CPU three times as fast with so few features

    def forward(
        self,
        change: Tensor,  # (B, 3, H, W) image minus untouched image, levels
        position: Tensor,  # (B, 2, H, W) or (1, 2, H, W) x and y of the pixels, -1 to 1 from rim to rim of the sensor
        pitch: tuple[float, float],  # size of a pixel along y and x, mm
        true_depth: Tensor | None = None,  # (B, H, W) mm, in training on windows of images
    ) -> LocalShape:
        """Read slopes, depth and contact.

        The integration assumes a depth of 0 at the rim, which a window does not have: the error of slopes is integrated
        instead, with `true_depth`. Contact is read from depth and slopes; the gradient of its loss does not reach them.
        """
        slopes = self.slopes(change, position)
        if true_depth is None:
            depth = integrate_slopes(slopes, pitch)
        else:
            depth = true_depth + integrate_slopes(slopes - surface_slopes(true_depth, pitch), pitch)
        return LocalShape(slopes, depth, self.contact(depth.detach(), slopes.detach()))

    def slopes(self, change: Tensor, position: Tensor) -> Tensor:  # (B, 2, H, W)
        """Read the slopes of depth along x and y; parameters as `forward`."""
        inputs = torch.cat([change / CHANGE_SCALE, position.expand(len(change), -1, -1, -1)], dim=1)
        slopes: Tensor = self.colours(inputs.contiguous(memory_format=torch.channels_last))
        return slopes

    def contact(self, depth: Tensor, slopes: Tensor) -> Tensor:
        """Find the contact, (B, H, W) logits, in (B, H, W) depth, mm, and (B, 2, H, W) slopes."""
        inputs = torch.cat([depth[:, None], slopes, slopes.square().sum(dim=1, keepdim=True)], dim=1)
        logits: Tensor = self.shape(inputs.contiguous(memory_format=torch.channels_last))[:, 0]
        return logits


def pixel_positions(rows: int, cols: int) -> Tensor:  # (1, 2, rows, cols) float32
    """Compute the positions of pixels for a `LocalNetwork`: x and y, -1 to 1 from rim to rim."""
    x, y = (2 * (torch.arange(count, dtype=torch.float32) + 0.5) / count - 1 for count in (cols, rows))
    return torch.stack([x.expand(rows, cols), y[:, None].expand(rows, cols)])[None]

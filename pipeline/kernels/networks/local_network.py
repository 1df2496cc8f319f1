"""A small network that reads a tactile image pixel by pixel: slopes from colours, depth from slopes; and its loss.

It sees a neighbourhood of 0.8 mm, so that it learns the meaning of colours and not the shapes of the training set. Depth is integrated from
slopes. Photographs' drift, a smooth difference of light, is subtracted beforehand.
"""

from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, smooth_l1_loss

from pipeline.errors import InvalidInput
from pipeline.kernels.networks.slope_integration import integrate_slopes, surface_slopes
from pipeline.kernels.tensors import COLOURS
from pipeline.kernels.touch.calibrated_shading import polynomial_terms

CHANGE_SCALE = 50.0  # levels of 255 that are scaled to 1 for the network: the usual change of colours in a contact
DEPTH, IN_CONTACT, SLOPES = 4.0, 4.0, 8.0  # weights: depth, mm; more in the contact; slopes
SMALL = 0.1  # slope error below which its square counts, or gentle slopes are read too steep, for what walls lose
STEEPEST = 4.0  # slope to which true slopes are clamped: colours do not show how steep a wall is
SIDE = 40  # pixels per side to which changes are averaged: drift is smooth
DEGREE = 2  # of the drift's polynomial: the contacts of one sensor are too small to be taken for drift
SCALE = 4.0  # levels of usual drift: pixels that differ from it by much more, as in contacts, hardly count
ROUNDS = 12  # of weighted least squares
HIDDEN = 0.1  # weight of no drift at a pixel that a contact hides: wide contacts leave too few others to extrapolate from


class LocalShape(NamedTuple):
    """The output of a `LocalNetwork`."""

    slopes: Tensor  # (B, 2, H, W)
    depth: Tensor  # (B, H, W) of the gel's surface below its rest, mm; 0 beyond the rim


class LocalNetwork(nn.Module):
    """Convolutions of 3 × 3, 3 × 3 dilated by 2, and 1 × 1 twice give slopes; their integral is the depth.

    `width` counts the features of the hidden layers; 20 make 5,000 parameters, 20 kB.
    """

    def __init__(self, width: int = 20) -> None:
        super().__init__()
        self.width = width
        self.colours = nn.Sequential(
            *(nn.Conv2d(COLOURS + 2, width, 3, padding=1), nn.ReLU(inplace=True)),
            *(nn.Conv2d(width, width, 3, padding=2, dilation=2), nn.ReLU(inplace=True)),
            *(nn.Conv2d(width, width, 1), nn.ReLU(inplace=True)),
            nn.Conv2d(width, 2, 1),
        )
        nn.Module.to(self, memory_format=torch.channels_last)  # type: ignore[call-overload]  # on a CPU three times as fast with so few features

    def forward(
        self,
        change: Tensor,  # (B, 3, H, W) image minus untouched image, levels
        position: Tensor,  # (B, 2, H, W) or (1, 2, H, W) x and y of the pixels, -1 to 1 from rim to rim of the sensor
        pitch: tuple[float, float],  # size of a pixel along y and x, mm
        true_depth: Tensor | None = None,  # (B, H, W) mm, in training on windows of images
    ) -> LocalShape:
        """Read slopes and depth.

        The integration assumes a depth of 0 at the rim, which a window does not have: the error of slopes is integrated instead, with
        `true_depth`.
        """
        colours = torch.cat([change / CHANGE_SCALE, position.expand(len(change), -1, -1, -1)], dim=1)
        slopes = self.colours(colours.contiguous(memory_format=torch.channels_last))
        if true_depth is None:
            depth = integrate_slopes(slopes, pitch)
        else:
            depth = true_depth + integrate_slopes(slopes - surface_slopes(true_depth, pitch), pitch)
        return LocalShape(slopes, depth)


def pixel_positions(rows: int, cols: int) -> Tensor:  # (1, 2, rows, cols) float32
    """Compute the positions of pixels for a `LocalNetwork`: x and y, -1 to 1 from rim to rim."""
    x, y = (2 * (torch.arange(count, dtype=torch.float32) + 0.5) / count - 1 for count in (cols, rows))
    return torch.stack([x.expand(rows, cols), y[:, None].expand(rows, cols)])[None]


def local_loss(
    shape: LocalShape,
    true_depth: Tensor,  # (B, H, W) of the gel's surface below its rest, mm
    true_contact: Tensor,  # (B, H, W) bool
    pitch: tuple[float, float],  # along y and x, mm
) -> Tensor:
    """Compute the loss of a batch, a scalar: the mean over all pixels."""
    if not bool(torch.isfinite(shape.slopes).all()):
        raise InvalidInput("the network reads NaN or infinite slopes: it has diverged; lower the learning rate")
    depth = ((shape.depth - true_depth).abs() * (1 + IN_CONTACT * true_contact)).mean()
    slopes = smooth_l1_loss(shape.slopes, surface_slopes(true_depth, pitch).clamp(-STEEPEST, STEEPEST), beta=SMALL)
    return DEPTH * depth + SLOPES * slopes


def without_drift(change: Tensor) -> Tensor:
    """Subtract the drift from changes (B, 3, H, W), image minus untouched image, levels.

    The drift is a polynomial of the position, fitted by iteratively reweighted least squares from a drift of 0: a pixel r levels away
    weighs w = 1 / (1 + (r / SCALE)²)², and with `HIDDEN` (1 - w) it says that there is no drift. The share of it that is subtracted is how
    many more pixels are then at rest, by their weights, over those that were: all if they are twice as many.
    """
    levels = interpolate(change, size=(SIDE, SIDE), mode="area").flatten(2).transpose(1, 2)  # (B, n, 3)
    terms = _terms(SIDE, SIDE, change.dtype, change.device)  # (n, k)
    drift = torch.zeros_like(levels)
    for _ in range(ROUNDS):
        weight = _at_rest(levels - drift)  # (B, n)
        at_rest, everywhere = ((part[:, :, None] * terms).transpose(1, 2) for part in (weight, weight + HIDDEN * (1 - weight)))
        coefficients = torch.linalg.solve(everywhere @ terms, at_rest @ levels)  # (B, k, 3)
        drift = terms @ coefficients
    before, after = (_at_rest(left).sum(dim=1) for left in (levels, levels - drift))  # (B,) pixels
    share = ((after - before) / (before + 1)).clamp(0, 1)
    rows, cols = change.shape[2:]
    fitted: Tensor = _terms(rows, cols, change.dtype, change.device) @ coefficients
    return change - share[:, None, None, None] * fitted.transpose(1, 2).reshape(change.shape)


def _at_rest(levels: Tensor) -> Tensor:  # (B, n)
    """Weigh pixels by how little their colours (B, n, 3) change."""
    return (1 + levels.square().sum(dim=2) / SCALE**2) ** -2


@lru_cache(maxsize=8)
def _terms(rows: int, cols: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Make the terms of the polynomial at every pixel, (rows * cols, k)."""
    with torch.inference_mode(False):  # they are cached, and a training may follow in this process
        y, x = (2 * (torch.arange(count, dtype=dtype, device=device) + 0.5) / count - 1 for count in (rows, cols))
        return torch.stack([term.flatten() for term in polynomial_terms(x[None], y[:, None], DEGREE)], dim=1)

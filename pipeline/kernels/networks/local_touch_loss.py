"""The loss of a local network: on slopes, on the depth that they integrate to over all pixels, and on the contact."""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits, smooth_l1_loss

from pipeline.errors import InvalidInput
from pipeline.kernels.networks.local_network import LocalShape
from pipeline.kernels.networks.slope_integration import surface_slopes

DEPTH, IN_CONTACT, SLOPES, CONTACT = 4.0, 4.0, 8.0, 0.3
"""Weight of the depth error, mm; additional weight of a pixel in the contact; weights of slopes and contact."""
SMALL = 0.1
"""Error of a slope below which its square counts. If small errors cost little, gentle slopes are read too steep, to make up for the depth
that is lost at walls."""
STEEPEST = 4.0  # slope to which true slopes are clamped: colours do not show how steep a wall is


class GelState(NamedTuple):
    """The true state of a batch of presses."""

    depth: Tensor  # (B, H, W) of the gel's surface below its rest, mm
    contact: Tensor  # (B, H, W) bool


def local_loss(
    shape: LocalShape,
    truth: GelState,
    pitch: tuple[float, float],  # size of a pixel along y and x, mm
) -> Tensor:
    """Compute the loss of a batch: a scalar, the mean over all pixels."""
    if not bool(torch.isfinite(shape.slopes).all()):
        raise InvalidInput("the network reads NaN or infinite slopes: it has diverged; lower the learning rate")
    depth = ((shape.depth - truth.depth).abs() * (1 + IN_CONTACT * truth.contact)).mean()
    slopes = smooth_l1_loss(shape.slopes, surface_slopes(truth.depth, pitch).clamp(-STEEPEST, STEEPEST), beta=SMALL)
    contact = binary_cross_entropy_with_logits(shape.contact, truth.contact.to(shape.contact.dtype))
    return DEPTH * depth + SLOPES * slopes + CONTACT * contact

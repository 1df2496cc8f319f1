"""Initial weights of networks."""

from __future__ import annotations

import torch
from torch import nn


def draw_weights(network: nn.Module, generator: torch.Generator | None) -> None:
    """Draw He's normal weights for all convolutions and linear layers of a network, in place; biases are zero.

    Parameters
    ----------
    network
        Its layers are set in the order of their names.
    generator
        Equal generators give equal weights; None for torch's global one.

    Notes
    -----
    He et al., Delving Deep into Rectifiers, 2015: features keep their size through 25 layers of ReLU.
    """
    for name, parameter in network.named_parameters():
        if parameter.ndim > 1:
            nn.init.kaiming_normal_(parameter, nonlinearity="relu", generator=generator)
        elif name.endswith("bias"):
            nn.init.zeros_(parameter)

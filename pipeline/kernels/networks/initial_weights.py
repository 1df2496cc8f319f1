"""Initial weights of networks."""

import torch
from torch import nn


def draw_weights(network: nn.Module, generator: torch.Generator | None) -> None:
    """Draw He's normal weights for all convolutions and linear layers of a network, in place; biases are zero.

    Layers are set in the order of their names. Equal generators give equal weights; None is torch's global one. He et
    al., Delving Deep into Rectifiers, 2015: features keep their size through 25 layers of ReLU.
    """
    for name, parameter in network.named_parameters():
        if parameter.ndim > 1:
            nn.init.kaiming_normal_(parameter, nonlinearity="relu", generator=generator)
        elif name.endswith("bias"):
            nn.init.zeros_(parameter)

"""Checks of tensors, conversion of stored images to network input, and initial weights of networks."""

import torch
from torch import Tensor, nn

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import WHITE

COLOURS = 3


def network_input(images: Tensor, dtype: torch.dtype) -> Tensor:
    """Convert stored images (B, H, W, 3) uint8 to a network's input (B, 3, H, W) in [0, 1]; channels stay last in memory."""
    if images.dtype != torch.uint8 or images.ndim != 4 or images.shape[3] != COLOURS:
        raise ValueError(f"images are {tuple(images.shape)} {images.dtype}; stored images are (B, H, W, {COLOURS}) uint8")
    return images.permute(0, 3, 1, 2).to(dtype).div_(WHITE)


def check_intensities(name: str, images: Tensor) -> None:
    """Refuse floating images whose values leave [0, 1], such as images not divided by 255; `name` is for messages."""
    low, high = images.detach().aminmax() if images.numel() else (0, 1)
    if not (low >= 0 and high <= 1):  # NaN is neither
        raise InvalidInput(f"{name} reach from {low:g} to {high:g}; floating images must lie in [0, 1]: divide by {WHITE}")


def draw_weights(network: nn.Module, generator: torch.Generator | None) -> None:
    """Draw He's normal weights for all convolutions and linear layers of a network, in place; biases are zero.

    Layers are set in the order of their names. Equal generators give equal weights; None is torch's global one.
    (He et al., Delving Deep into Rectifiers, 2015: features keep their size through 25 layers of ReLU.)
    """
    for name, parameter in network.named_parameters():
        if parameter.ndim > 1 and not parameter.is_meta:  # a draw there imports torch's compiler, which takes as long as torch
            nn.init.kaiming_normal_(parameter, nonlinearity="relu", generator=generator)
        elif name.endswith("bias"):
            nn.init.zeros_(parameter)

"""Conversion of stored images to network input."""

from fractions import Fraction

import pytest
import torch
from torch import Tensor

from pipeline.kernels.arrays import WHITE
from pipeline.kernels.tensors import network_input


@pytest.mark.parametrize("images", [torch.zeros(1, 4, 4, 3), torch.zeros(4, 4, 3, dtype=torch.uint8), torch.zeros(1, 3, 4, 4).byte()])
def test_network_input_rejects_other_than_stored_images(images: Tensor) -> None:
    """A float image would be divided by 255 a second time."""
    with pytest.raises(ValueError, match=r"\(B, H, W, 3\) uint8"):
        network_input(images, torch.float32)


def test_network_input_divides_by_255() -> None:
    ramp = torch.arange(256, dtype=torch.uint8).reshape(1, 256, 1, 1).expand(1, 256, 1, 3)
    for dtype, bound in ((torch.float32, 6e-8), (torch.float64, 2e-16)):
        found = network_input(ramp, dtype)[0, 0, :, 0]
        assert max(abs(Fraction(value) - Fraction(k, WHITE)) for k, value in enumerate(found.tolist())) <= bound
        assert (float(found[0]), float(found[-1])) == (0, 1)

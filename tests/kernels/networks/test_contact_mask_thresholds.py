"""Contact masks at thresholds that floats cannot represent, and network input."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from pipeline.kernels.networks.contact_mask import contact_mask
from pipeline.kernels.tensor_checks import COLOURS, WHITE, network_input
from tests.kernels.networks.pictures import KINDS, stored
from tests.strategies import seeds


@given(seed=seeds, pixel=st.integers(0, 23), beside=st.sampled_from([0, COLOURS]))
def test_contact_mask_is_exact_at_any_threshold(seed: int, pixel: int, beside: int) -> None:
    """At the squared norm of one of the pixels and the float next to it, where a rounded product decides wrongly."""
    blank, tactile_images = np.random.default_rng(seed).integers(0, 256, (2, 6, 4, 3), dtype=np.uint8)
    squares = np.square(tactile_images.astype(int) - blank).reshape(-1, 3).sum(axis=1).tolist()
    threshold = float(np.nextafter(squares[pixel] / WHITE**2, beside))
    expected = [Fraction(square, WHITE**2) > Fraction(threshold) for square in squares]
    assert contact_mask(torch.from_numpy(tactile_images), torch.from_numpy(blank), threshold).flatten().tolist() == expected


@pytest.mark.parametrize("square", [1, 65, 66, 4225, 65025, 194566, 195075])
def test_threshold_next_to_a_squared_norm_separates_it_from_the_next(square: int) -> None:
    """Tactile images whose every pixel has that squared norm exactly: just below the threshold, at it, and just above."""
    parts = next(
        (r, g, b)
        for r in range(WHITE + 1)
        for g in range(r + 1)
        for b in [math.isqrt(max(square - r * r - g * g, 0))]
        if b <= g and r * r + g * g + b * b == square
    )
    tactile_images, blank = torch.tensor(parts, dtype=torch.uint8).expand(2, 2, 3), torch.zeros(2, 2, 3, dtype=torch.uint8)
    exactly = Fraction(square, WHITE**2)
    for threshold in (np.nextafter(square / WHITE**2, 0), square / WHITE**2, np.nextafter(square / WHITE**2, COLOURS)):
        assert bool(contact_mask(tactile_images, blank, float(threshold)).all()) == (exactly > Fraction(float(threshold)))


@pytest.mark.parametrize("kind", KINDS)
def test_contact_mask_of_an_image_with_itself_is_empty(kind: str) -> None:
    image = stored(kind, 9)
    assert not contact_mask(image, image, 0.0).any()


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float32])
def test_contact_mask_rejects_floating_images(dtype: torch.dtype) -> None:
    with pytest.raises(ValueError, match=f"images are {dtype}.*as they are stored, uint8"):
        contact_mask(torch.zeros(2, 2, 3, dtype=dtype), torch.zeros(2, 2, 3, dtype=dtype))


@pytest.mark.parametrize("threshold", [math.inf, math.nan, -1e-9])
def test_threshold_must_be_finite_and_not_negative(threshold: float) -> None:
    blank = torch.zeros(2, 2, 3, dtype=torch.uint8)
    with pytest.raises(ValueError, match="threshold"):
        contact_mask(blank, blank, threshold)


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

"""Contact masks against section 2.2 pixel by pixel and in fractions, and rejected images."""

from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.arrays import WHITE
from pipeline.kernels.networks.unet import contact_mask
from pipeline.kernels.tensors import COLOURS
from tests.strategies import seeds


def slow_mask(tactile_images: np.ndarray, blank: np.ndarray, threshold: float) -> np.ndarray:
    """Every pixel by itself, in Python's floats."""
    mask = np.zeros(tactile_images.shape[:-1], bool)
    for index in np.ndindex(mask.shape):
        row, col = index[-2:]
        squared = 0.0
        for channel in range(3):
            squared += ((float(tactile_images[*index, channel]) - float(blank[row, col, channel])) / 255) ** 2
        mask[index] = squared > threshold
    return mask


def black(*shape: int) -> torch.Tensor:
    return torch.zeros(shape, dtype=torch.uint8)


@pytest.mark.parametrize("threshold", [0.0, 0.001, 0.01])
def test_contact_mask_equals_the_slow_twin(threshold: float) -> None:
    rng = np.random.default_rng(0)
    blank = rng.integers(0, 256, (7, 5, 3), dtype=np.uint8)
    tactile_images = np.clip(blank + rng.integers(-20, 21, (2, 4, 7, 5, 3)) * rng.integers(0, 2, (2, 4, 7, 5, 1)), 0, 255).astype(np.uint8)
    expected = slow_mask(tactile_images, blank, threshold)
    assert 0 < expected.sum() < expected.size
    assert (contact_mask(torch.from_numpy(tactile_images), torch.from_numpy(blank), threshold).numpy() == expected).all()


@given(seed=seeds, pixel=st.integers(0, 23))
def test_contact_mask_is_exact_at_any_threshold(seed: int, pixel: int) -> None:
    """At the squared norm of one of the pixels and the floats next to it, where a rounded product decides wrongly."""
    blank, tactile_images = np.random.default_rng(seed).integers(0, 256, (2, 6, 4, 3), dtype=np.uint8)
    blank[0], tactile_images[0] = 0, [[0, 0, 0], [1, 0, 0], [WHITE, 0, 0], [WHITE, WHITE, WHITE]]
    squares = np.square(tactile_images.astype(int) - blank).reshape(-1, 3).sum(axis=1).tolist()
    norm = squares[pixel] / WHITE**2
    for threshold in map(float, (np.nextafter(norm, 0), norm, np.nextafter(norm, COLOURS))):
        expected = [Fraction(square, WHITE**2) > Fraction(threshold) for square in squares]
        assert contact_mask(torch.from_numpy(tactile_images), torch.from_numpy(blank), threshold).flatten().tolist() == expected

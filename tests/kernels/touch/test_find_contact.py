"""Contacts whose rims are too blurred to see."""

import numpy as np
import pytest

from pipeline.kernels.touch.find_contact import find_contact


@pytest.mark.parametrize("size", [10.0, 16.0])
def test_contact_without_a_rim_is_found_by_symmetry(size: float) -> None:
    """A dimple that is a bell, lit from three sides: colours are greatest at `size`, and fade fastest at sqrt(3) `size`."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(160) - 90.3, np.arange(120) - 54.8)
    towards = 2 * np.pi / 3 * np.arange(3)
    slope = (x[..., None] * np.cos(towards) + y[..., None] * np.sin(towards)) / size * np.exp(-(x**2 + y**2) / 2 / size**2)[..., None]
    untouched = np.full((120, 160, 3), 120, np.uint8)
    image = np.rint(untouched + 100 * slope + rng.normal(0, 1.5, slope.shape)).astype(np.uint8)
    found = find_contact(image, untouched)
    assert np.hypot(found.x - 90.3, found.y - 54.8) < 2.5
    assert found.radius == pytest.approx(np.sqrt(3) * size, rel=0.15)

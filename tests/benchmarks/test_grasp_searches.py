"""Measures of the benchmark of grasp searches."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.grasp_searches import REACHED, covered


def test_covered_surface_is_a_disc_around_each_contact_with_area() -> None:
    side = np.linspace(-0.1, 0.1, 401)
    plane = np.stack([*np.meshgrid(side, side), np.zeros((401, 401))], axis=-1).reshape(-1, 3)
    points = np.array([[[-0.05, 0, 0], [0.05, 0, 0], [0, 0, 0]]])
    row = {"contact_point": points, "contact_area": np.array([[1e-5, 1e-5, 0]])}
    assert covered(plane, row) == pytest.approx(2 * np.pi * REACHED**2 / 0.2**2, rel=0.02)
    assert covered(plane, row | {"contact_area": np.zeros((1, 3))}) == 0

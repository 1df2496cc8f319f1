"""The planar grid finds the neighbours that a comparison of all pairs finds, among clouds of any kind."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from pipeline.kernels.charts.chart_steps import nearest_in, planar_grid
from tests.kernels.degenerate_clouds import KINDS, OFFSETS, cloud
from tests.strategies import scales, seeds


@given(kind=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_nearest_is_that_of_all_pairs(kind: str, seed: int, scale: float, offset: np.ndarray) -> None:
    points, rng = cloud(kind, seed, scale, offset), np.random.default_rng(seed)
    spread = [points[rng.integers(len(points), size=6)] + scale * reach * rng.normal(size=(6, 3)) for reach in (0.0, 0.01, 1.0, 100.0)]
    queries = np.concatenate([*spread, np.zeros((1, 3))])
    grid = planar_grid(points)
    assert (points[grid.numbers] == grid.points).all()
    squared = np.square(queries[:, None] - points).sum(axis=2)
    nearest = grid.numbers[nearest_in(grid, queries)]
    rounding = 1e-14 * np.abs(points).max()  # of a cell's edge
    np.testing.assert_array_less(
        np.sqrt(squared[np.arange(len(queries)), nearest]), np.sqrt(squared.min(axis=1)) * (1 + 1e-12) + rounding + 1e-300
    )


@pytest.mark.parametrize("height", [0.0, 0.02, 0.4])
def test_nearest_of_two_layers_is_that_of_all_pairs(height: float) -> None:
    rng = np.random.default_rng(0)
    points, queries = (rng.uniform(-0.5, 0.5, (count, 3)) * [1, 1, 0.04] for count in (700, 300))
    queries[:, 2] += height
    grid = planar_grid(points)
    nearest = np.square(queries[:, None] - points).sum(axis=2).argmin(axis=1)
    np.testing.assert_array_equal(grid.numbers[nearest_in(grid, queries)], nearest)
    assert grid.columns * grid.rows <= 2 * len(points)


def test_points_along_an_axis_fill_few_cells() -> None:
    grid = planar_grid(np.linspace(0, 1, 1000)[:, None] * [1.0, 0.0, 0.0])
    assert grid.rows == 1
    assert grid.columns <= 501

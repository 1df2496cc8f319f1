"""The planar grid finds the neighbours that a comparison of all pairs finds."""

import numpy as np
import pytest

from pipeline.kernels.charts.chart_steps import nearest_in, planar_grid


@pytest.mark.parametrize("height", [0.0, 0.4])
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

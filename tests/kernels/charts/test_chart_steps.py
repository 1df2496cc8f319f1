"""Steps of a chart against torch, and the grid that finds nearest points."""

import numpy as np
import pytest
import torch

from pipeline.kernels.charts.chart_steps import ChartState, chart_area, nearest_in, planar_grid, take_steps
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.metrics.chamfer import map_to_surface

RNG = np.random.default_rng(0)
SQUARE, FACES = chart_square()
BENT = SQUARE.numpy() + RNG.normal(scale=0.03, size=SQUARE.shape)
CLOUD = RNG.uniform(-0.5, 0.5, (120, 3)) * [1, 1, 0.2] + [0, 0, 0.1]
UNIFORM = RNG.uniform(size=(4, 90, 3))


def chart(vertices: np.ndarray) -> ChartState:
    return ChartState(vertices.copy(), np.zeros_like(vertices), np.zeros_like(vertices), FACES.numpy())


def loss_of(vertices: torch.Tensor, uniform: np.ndarray, cloud: np.ndarray, target: np.ndarray) -> torch.Tensor:
    """Compute the mean squared distances from samples to the target and from the cloud to samples, by all pairs."""
    drawn = map_to_surface(vertices, FACES, torch.from_numpy(uniform))
    to_target, to_samples = (
        torch.cdist(a, b).min(dim=1).indices for a, b in ((drawn, torch.from_numpy(target)), (torch.from_numpy(cloud), drawn))
    )
    nearest = torch.from_numpy(target)[to_target]
    return (drawn - nearest).square().sum(dim=1).mean() + (drawn[to_samples] - torch.from_numpy(cloud)).square().sum(dim=1).mean()


def test_steps_are_those_of_adam_with_the_parts_in_turn() -> None:
    vertices = torch.from_numpy(BENT.copy()).requires_grad_()
    adam, parts = torch.optim.Adam([vertices], lr=0.01), CLOUD.reshape(3, 40, 3)
    first = float(loss_of(vertices.detach(), UNIFORM[0], parts[0], parts[0]))
    targets, expected = (parts[0], CLOUD, CLOUD, CLOUD), []  # the first loss is below the limit: the chart is near
    for step, uniform in enumerate(UNIFORM):
        adam.zero_grad()
        loss = loss_of(vertices, uniform, parts[step % 3], targets[step])
        loss.backward()
        adam.step()
        expected.append(float(loss.detach()))
    stepped = chart(BENT)
    losses = take_steps(stepped, UNIFORM, parts, (planar_grid(parts[0]), planar_grid(CLOUD)), 1.01 * first, 0, 0.01)
    np.testing.assert_allclose(losses, expected, rtol=1e-10)
    np.testing.assert_allclose(stepped.vertices, vertices.detach(), rtol=0, atol=1e-10)


def test_chart_without_area_takes_no_step() -> None:
    point = chart(np.zeros_like(BENT))
    assert chart_area(point) == 0
    assert not len(take_steps(point, UNIFORM, CLOUD[None], (planar_grid(CLOUD), planar_grid(CLOUD)), 1.0, 0, 0.01))
    assert chart_area(chart(SQUARE.numpy())) == pytest.approx(1)


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

from __future__ import annotations

import numpy as np
import pytest
import torch

from pipeline.kernels.charts.chart_sphere import chart_sphere
from pipeline.kernels.networks.graph import batch_graph
from tests.learning.graph_twin import dense_mean

CPU = torch.device("cpu")


@pytest.mark.parametrize(("splits", "side", "counts"), [(0, 3, [0]), (0, 3, [2]), (0, 5, [1, 0, 3]), (0, 3, [2, 2])])
def test_the_averages_of_a_loop_over_faces(splits: int, side: int, counts: list[int]) -> None:
    sphere = chart_sphere(splits)
    graph = batch_graph(sphere, side, counts, CPU, torch.float64)
    expected = dense_mean(sphere.faces, sphere.vertices, sphere.centres, side, counts)
    np.testing.assert_allclose(graph.mean.to_dense().numpy(), expected, rtol=1e-15)
    np.testing.assert_allclose(graph.transposed.to_dense().numpy(), expected.T, rtol=1e-15)


def test_full_size() -> None:
    sphere = chart_sphere()
    graph = batch_graph(sphere, 9, [4, 20], CPU, torch.float32)
    assert graph.sizes == (1824 + 4 * 81, 1824 + 20 * 81)
    assert tuple(graph.mean.shape) == (sum(graph.sizes),) * 2
    ones = torch.ones(sum(graph.sizes), 1)
    torch.testing.assert_close(graph.mean @ ones, ones)
    degree = graph.mean.crow_indices().diff()
    touch_centre = 1824 + 40
    assert degree[touch_centre] == 1 + 6 + 96  # itself, the square's diagonals lie alike, every vision chart
    assert degree[sphere.centres[0]] == 1 + 6 + 4
    assert degree[graph.sizes[0] + sphere.centres[0]] == 1 + 6 + 20


def test_items_do_not_see_each_other() -> None:
    graph = batch_graph(chart_sphere(0), 3, [1, 2], CPU, torch.float64)
    dense = graph.mean.to_dense()
    first = graph.sizes[0]
    assert not dense[:first, first:].any()
    assert not dense[first:, :first].any()


def test_joining_vision_and_touch() -> None:
    graph = batch_graph(chart_sphere(0), 3, [1, 0, 2], CPU, torch.float32)
    vision = torch.arange(3 * 456).reshape(3, 456, 1)
    touch = -1 - torch.arange(27)[:, None]
    joined = graph.join(vision, touch)
    expected = [*range(456), *range(-1, -10, -1), *range(456, 912), *range(912, 1368), *range(-10, -28, -1)]
    assert joined[:, 0].tolist() == expected
    torch.testing.assert_close(graph.of_vision(joined), vision)
    with pytest.raises(ValueError, match=r"vision \(2, 456, 1\) and touch \(27, 1\)"):
        graph.join(vision[:2], touch)


def test_joining_without_touch() -> None:
    graph = batch_graph(chart_sphere(0), 3, [0, 0], CPU, torch.float32)
    vision = torch.rand(2, 456, 5)
    torch.testing.assert_close(graph.join(vision, torch.zeros(0, 5)), vision.reshape(-1, 5))


@pytest.mark.parametrize("counts", [[], [2, -1]])
def test_counts_that_are_no_batch(counts: list[int]) -> None:
    with pytest.raises(ValueError, match="counts is"):
        batch_graph(chart_sphere(0), 3, counts, CPU, torch.float32)

"""The graph of charts and the convolutions on it, against dense matrices."""

import numpy as np
import pytest
import torch
from torch import nn

from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.networks.deformation_network import ChartGraph, ZeroNeighbourLayer, chart_graph
from tests.references.dense_graph import dense_mean

FLOAT32, FLOAT64 = torch.zeros((), dtype=torch.float32), torch.zeros((), dtype=torch.float64)


@pytest.mark.parametrize(("splits", "side", "counts"), [(0, 3, [0]), (0, 3, [2]), (0, 5, [1, 0, 3]), (0, 3, [20])])
def test_mean_equals_dense_adjacency_of_a_loop_over_faces(splits: int, side: int, counts: list[int]) -> None:
    sphere = vision_charts(splits)
    graph = chart_graph(sphere, side, counts, FLOAT64)
    expected = dense_mean(sphere.faces, sphere.vertices, sphere.centres, side, counts)
    np.testing.assert_allclose((graph.adjacency.to_dense() / graph.degree).numpy(), expected, rtol=1e-15)


@pytest.mark.parametrize("counts", [[0], [2], [1, 0, 3]])
def test_touch_edges_all_connect_centres_to_vision_vertices_one_way(counts: list[int]) -> None:
    sphere = vision_charts(0)
    graph = chart_graph(sphere, 3, counts, FLOAT64, touch_edges="all")
    expected = dense_mean(sphere.faces, sphere.vertices, sphere.centres, 3, counts, touch_edges="all")
    identity = torch.eye(sum(graph.sizes), dtype=torch.float64)
    np.testing.assert_allclose(graph.average(identity).numpy(), expected, rtol=1e-15)


def test_full_size_graph_has_the_supplements_degrees() -> None:
    sphere = vision_charts()
    graph = chart_graph(sphere, 9, [4, 20], FLOAT32)
    assert graph.sizes == [1824 + 4 * 81, 1824 + 20 * 81]
    assert tuple(graph.adjacency.shape) == (sum(graph.sizes),) * 2
    ones = torch.ones(sum(graph.sizes), 1)
    torch.testing.assert_close(graph.average(ones), ones)
    degree = graph.degree[:, 0]
    touch_centre = 1824 + 40
    assert degree[touch_centre] == 1 + 6 + 96  # itself, the square's diagonals lie alike, every vision chart
    assert degree[sphere.centres[0]] == 1 + 6 + 4
    assert degree[graph.sizes[0] + sphere.centres[0]] == 1 + 6 + 20


def test_join_orders_features_by_item() -> None:
    graph = chart_graph(vision_charts(0), 3, [1, 0, 2], FLOAT32)
    vision, touch = torch.arange(3 * 456).reshape(3, 456, 1), -torch.arange(1, 3 * 9 + 1).reshape(3, 9, 1)
    features = graph.join(vision, touch)
    assert torch.equal(graph.vision_vertices(features), vision)
    assert features[features < 0].tolist() == touch.flatten().tolist()
    assert [int((item < 0).sum()) for item in torch.split(features, graph.sizes)] == [9, 0, 18]


COUNTS = [2, 0, 1]


@pytest.fixture(scope="module")
def graph() -> ChartGraph:
    return chart_graph(vision_charts(0), 3, COUNTS, torch.zeros((), dtype=torch.float64))


@pytest.fixture(scope="module")
def dense() -> torch.Tensor:
    sphere = vision_charts(0)
    return torch.from_numpy(dense_mean(sphere.faces, sphere.vertices, sphere.centres, 3, COUNTS))


def slow_layer(features: torch.Tensor, linear: nn.Linear, dense: torch.Tensor, mixed: int) -> torch.Tensor:
    mapped = features @ linear.weight.T + linear.bias
    return torch.cat([dense @ mapped[:, :mixed], mapped[:, mixed:]], dim=1).clamp(min=0)


@pytest.mark.parametrize(("mixed", "columns"), [(1 / 3, 3), (0.0, 0), (1.0, 11), (0.1, 1)])
def test_layer_and_its_gradients_equal_those_with_a_dense_adjacency(
    graph: ChartGraph, dense: torch.Tensor, mixed: float, columns: int
) -> None:
    generator = torch.Generator().manual_seed(1)
    layer = ZeroNeighbourLayer(7, 11, mixed).double()
    assert layer.mixed == columns
    features = torch.randn(len(dense), 7, dtype=torch.float64, generator=generator, requires_grad=True)
    weights = torch.randn(len(dense), 11, dtype=torch.float64, generator=generator)
    wanted = [features, layer.linear.weight, layer.linear.bias]
    fast = layer(features, graph)
    fast_gradients = torch.autograd.grad((fast * weights).sum(), wanted)
    slow = slow_layer(features, layer.linear, dense, columns)
    slow_gradients = torch.autograd.grad((slow * weights).sum(), wanted)
    torch.testing.assert_close(fast, slow, rtol=1e-12, atol=1e-12)
    for one, other in zip(fast_gradients, slow_gradients, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-11, atol=1e-11)


def test_autocast_maps_in_half_and_averages_in_full_precision(graph: ChartGraph) -> None:
    single = chart_graph(vision_charts(0), 3, COUNTS, torch.zeros(()))
    layer = ZeroNeighbourLayer(4, 6)
    features = torch.randn(sum(single.sizes), 4, generator=torch.Generator().manual_seed(4))
    with torch.autocast("cpu", torch.bfloat16):
        mixed = layer(features, single)
    assert mixed.dtype == torch.bfloat16
    torch.testing.assert_close(mixed.float(), layer(features, single), rtol=0.02, atol=0.02)
    mixed.sum().backward()

"""Graph convolutions against dense adjacency matrices."""

import pytest
import torch
from torch import nn

from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.networks.chart_graph import ChartGraph, ZeroNeighbourLayer, chart_graph
from tests.references.dense_graph import dense_mean

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

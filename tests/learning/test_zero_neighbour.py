from __future__ import annotations

import pytest
import torch
from torch import nn

from pipeline.kernels.charts.chart_sphere import chart_sphere
from pipeline.kernels.networks.graph import ChartGraph, batch_graph
from pipeline.kernels.networks.graph_network import GraphNetwork
from pipeline.kernels.networks.zero_neighbour import ZeroNeighbourLayer
from tests.learning.graph_twin import dense_mean

COUNTS = [2, 0, 1]


@pytest.fixture(scope="module")
def graph() -> ChartGraph:
    return batch_graph(chart_sphere(0), 3, COUNTS, torch.device("cpu"), torch.float64)


@pytest.fixture(scope="module")
def dense() -> torch.Tensor:
    sphere = chart_sphere(0)
    return torch.from_numpy(dense_mean(sphere.faces, sphere.vertices, sphere.centres, 3, COUNTS))


def slow_layer(features: torch.Tensor, linear: nn.Linear, dense: torch.Tensor, mixed: int) -> torch.Tensor:
    mapped = features @ linear.weight.T + linear.bias
    return torch.cat([dense @ mapped[:, :mixed], mapped[:, mixed:]], dim=1).clamp(min=0)


@pytest.mark.parametrize(("mixed", "columns"), [(1 / 3, 3), (0.0, 0), (1.0, 11), (0.1, 1)])
def test_values_and_gradients_of_a_dense_adjacency(graph: ChartGraph, dense: torch.Tensor, mixed: float, columns: int) -> None:
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


def test_gradcheck() -> None:
    graph = batch_graph(chart_sphere(0), 3, [1], torch.device("cpu"), torch.float64)
    layer = ZeroNeighbourLayer(2, 3).double()
    features = torch.randn(graph.sizes[0], 2, dtype=torch.float64, generator=torch.Generator().manual_seed(2), requires_grad=True)
    assert torch.autograd.gradcheck(lambda given: layer(given, graph), features, fast_mode=True)


def test_the_gradient_given_is_left_alone(graph: ChartGraph) -> None:
    layer = ZeroNeighbourLayer(4, 6).double()
    gradient = torch.ones(sum(graph.sizes), 6, dtype=torch.float64)
    layer(torch.randn(sum(graph.sizes), 4, dtype=torch.float64), graph).backward(gradient)
    assert (gradient == 1).all()


def test_a_network_is_its_layers(graph: ChartGraph, dense: torch.Tensor) -> None:
    network = GraphNetwork(in_features=4, layers=4, features=9).double()
    features = torch.randn(len(dense), 4, dtype=torch.float64, generator=torch.Generator().manual_seed(3))
    expected = features
    for layer in network.hidden:
        assert isinstance(layer, ZeroNeighbourLayer)
        expected = slow_layer(expected, layer.linear, dense, 3)
    assert len(network.hidden) == 3
    torch.testing.assert_close(network(features, graph), network.last(expected))


def test_twice_the_same_to_the_bit(graph: ChartGraph) -> None:
    network = GraphNetwork(4, 5, 30).float()
    single = batch_graph(chart_sphere(0), 3, COUNTS, torch.device("cpu"), torch.float32)
    features = torch.randn(sum(single.sizes), 4)
    results = []
    for _ in range(2):
        moved = network(features, single)
        results.append([moved, *torch.autograd.grad(moved.square().sum(), list(network.parameters()))])
    assert all(torch.equal(one, other) for one, other in zip(*results, strict=True))


def test_half_precision_maps_and_full_precision_averages(graph: ChartGraph) -> None:
    single = batch_graph(chart_sphere(0), 3, COUNTS, torch.device("cpu"), torch.float32)
    layer = ZeroNeighbourLayer(4, 6)
    features = torch.randn(sum(single.sizes), 4, generator=torch.Generator().manual_seed(4))
    with torch.autocast("cpu", torch.bfloat16):
        mixed = layer(features, single)
    assert mixed.dtype == torch.bfloat16
    torch.testing.assert_close(mixed.float(), layer(features, single), rtol=0.02, atol=0.02)
    mixed.sum().backward()


def test_shapes_that_do_not_fit(graph: ChartGraph) -> None:
    with pytest.raises(ValueError, match=r"features are \(3, 4\), but graph and layer take \(1395, 4\)"):
        ZeroNeighbourLayer(4, 6)(torch.zeros(3, 4), graph)
    with pytest.raises(ValueError, match=r"mixed is 1\.5"):
        ZeroNeighbourLayer(4, 6, 1.5)
    with pytest.raises(ValueError, match="layers is 1"):
        GraphNetwork(4, 1, 6)


@pytest.mark.parametrize("features", [7, 16, 20])
def test_columns_of_zeros_that_make_products_faster_change_nothing(features: int) -> None:
    graph = batch_graph(chart_sphere(0), 3, [1, 0], torch.device("cpu"), torch.float64)
    network = GraphNetwork(5, 4, features).double()
    given = torch.randn(graph.mean.shape[0], 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    plain = given
    for layer in network.hidden:
        plain = layer(plain, graph)
    plain = network.last(plain)
    aligned = network(given, graph)
    torch.testing.assert_close(aligned, plain, rtol=1e-12, atol=1e-12)
    for one, other in zip(
        *(torch.autograd.grad(out.square().sum(), [given, *network.parameters()]) for out in (plain, aligned)), strict=True
    ):
        torch.testing.assert_close(one, other, rtol=1e-10, atol=1e-12)

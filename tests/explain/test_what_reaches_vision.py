"""The last layers without the vertices that reach no vision vertex, beside all layers with all."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pipeline.kernels.charts.chart_sphere import chart_sphere
from pipeline.kernels.networks.graph import CUTS, batch_graph
from pipeline.kernels.networks.graph_network import GraphNetwork

CPU = torch.device("cpu")


@pytest.mark.parametrize("layers", [2, 3, 6, 9])
@pytest.mark.parametrize(("side", "counts"), [(9, [2, 0, 1]), (3, [1, 4]), (5, [0, 0])])
def test_vision_vertices_and_all_gradients_are_those_of_the_whole_graph(layers: int, side: int, counts: list[int]):
    graph = batch_graph(chart_sphere(0), side, counts, CPU, torch.float64)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = GraphNetwork(4, layers, 18).double()
        features = torch.randn(sum(graph.sizes), 4, dtype=torch.float64)
    results = []
    for way in (network.of_vision, lambda given, graph: graph.of_vision(network(given, graph))):
        given = features.clone().requires_grad_()
        moved = way(given, graph)
        results.append([moved, *torch.autograd.grad(moved.square().sum(), [given, *network.parameters()])])
    assert results[0][0].shape == (len(counts), graph.vision, 3)
    for ours, whole in zip(*results, strict=True):
        torch.testing.assert_close(ours, whole, rtol=1e-11, atol=1e-12)


def test_a_cut_holds_what_lies_within_so_many_edges():
    graph = batch_graph(chart_sphere(0), 9, [1, 2], CPU, torch.float64)
    distance = np.full(sum(graph.sizes), np.inf)
    first = np.cumsum([0, *graph.sizes[:-1]])
    distance[np.concatenate([start + np.arange(graph.vision) for start in first])] = 0
    adjacency = graph.mean.to_dense().numpy() > 0
    for step in range(CUTS):
        reached = adjacency[distance == step].any(axis=0)
        distance[reached] = np.minimum(distance[reached], step + 1)
    for k, cut in enumerate(graph.cuts):
        np.testing.assert_array_equal(cut.entering, np.flatnonzero(distance <= k + 1))
        np.testing.assert_array_equal(cut.entering[cut.leaving], np.flatnonzero(distance <= k))
        rows, columns = np.flatnonzero(distance <= k), np.flatnonzero(distance <= k + 1)
        part = graph.mean.to_dense()[np.ix_(rows, columns)]
        torch.testing.assert_close(cut.mean.to_dense(), part, rtol=0, atol=0)
        torch.testing.assert_close(cut.transposed.to_dense(), part.T, rtol=0, atol=0)
    assert len(graph.cuts[0].entering) == 2 * graph.vision + 3  # a chart's centre alone


def test_a_vertex_that_is_left_out_has_no_say():
    graph = batch_graph(chart_sphere(0), 9, [1], CPU, torch.float64)
    network = GraphNetwork(4, 4, 12).double()
    features = torch.randn(sum(graph.sizes), 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    other = features.clone()
    far = np.setdiff1d(np.arange(len(features)), graph.cuts[2].entering)
    assert len(far) > 40
    other[far] += 1
    assert torch.equal(network.of_vision(features, graph), network.of_vision(other, graph))
    torch.testing.assert_close(graph.of_vision(network(features, graph)), graph.of_vision(network(other, graph)), rtol=0, atol=1e-14)

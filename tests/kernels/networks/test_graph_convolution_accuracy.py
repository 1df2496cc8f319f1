"""Graph convolutions with no, one and twenty touch charts, at features of any size."""

from __future__ import annotations

import copy
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn

from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.networks.chart_graph import ChartGraph, GraphConvolutionNetwork, ZeroNeighbourLayer, chart_graph
from tests.strategies import seeds

COUNTS = st.lists(st.sampled_from([0, 1, 4, 20]), min_size=1, max_size=3)
TYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])


def graph_of(counts: list[int], dtype: torch.dtype = torch.float64) -> ChartGraph:
    return chart_graph(vision_charts(0), 3, counts, torch.zeros((), dtype=dtype))


def layer_of(mixed: float, dtype: torch.dtype = torch.float64) -> ZeroNeighbourLayer:
    layer = ZeroNeighbourLayer(4, 6, mixed).to(dtype)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        layer.linear.weight.normal_(generator=generator)
    nn.init.zeros_(layer.linear.bias)
    return layer


@TYPES
@given(counts=COUNTS, seed=seeds, exponent=st.integers(-6, 6))
def test_averages_lie_between_minimum_and_maximum(dtype: torch.dtype, counts: list[int], seed: int, exponent: int) -> None:
    graph = graph_of(counts, dtype)
    values = torch.randn(sum(graph.sizes), 3, generator=torch.Generator().manual_seed(seed % 2**31), dtype=torch.float64)
    values = (values * 10.0**exponent).to(dtype)
    averages, slack = graph.average(values), 1e-5 if dtype == torch.float32 else 1e-14
    assert float((averages - values.max()).max()) <= slack * 10.0**exponent
    assert float((averages - values.min()).min()) >= -slack * 10.0**exponent
    torch.testing.assert_close(graph.average(torch.ones_like(values)), torch.ones_like(values), rtol=slack, atol=0)


@TYPES
@given(seed=seeds, power=st.integers(-20, 20), mixed=st.sampled_from([0.0, 1 / 3, 1.0]))
def test_layer_without_bias_scales_with_its_features_bit_for_bit(dtype: torch.dtype, seed: int, power: int, mixed: float) -> None:
    """Value and gradient from 1e-6 to 1e6: the layer adds no constant of fixed size."""
    graph, layer = graph_of([1, 0], dtype), layer_of(mixed, dtype)
    features = torch.randn(sum(graph.sizes), 4, generator=torch.Generator().manual_seed(seed % 2**31), dtype=dtype)
    found = []
    for factor in (1.0, 2.0**power):
        given = (features * factor).requires_grad_()
        made = layer(given, graph)
        found.append((made / factor, *torch.autograd.grad(made.sum(), given)))
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))


@given(counts=COUNTS, seed=seeds)
def test_gradients_in_float32_are_those_of_float64(counts: list[int], seed: int) -> None:
    """Through six layers, in the root mean square: rounding may put a feature on the other side of a ReLU's kink, one in some million."""
    torch.manual_seed(seed % 2**31)
    network = GraphConvolutionNetwork(5, 6, 24)
    features = torch.randn(sum(graph_of(counts).sizes), 5, generator=torch.Generator().manual_seed(seed % 2**31))
    found: list[list[Tensor]] = []
    for dtype in (torch.float32, torch.float64):
        given, twin = features.to(dtype).requires_grad_(), copy.deepcopy(network).to(dtype)
        moved = twin(given, graph_of(counts, dtype))
        found.append([moved.detach(), *torch.autograd.grad(moved.square().mean(), [given, *twin.parameters()])])
    for single, double in zip(*found, strict=True):
        assert float((single - double).norm()) <= 1e-2 * float(double.norm()) + 1e-30


def test_zero_features_give_the_bias_and_its_average() -> None:
    graph, layer = graph_of([1]), layer_of(1 / 3)
    nn.init.constant_(layer.linear.bias, 0.5)
    output = layer(torch.zeros(sum(graph.sizes), 4, dtype=torch.float64), graph)
    torch.testing.assert_close(output, torch.full_like(output, 0.5), rtol=1e-15, atol=0)
    nn.init.constant_(layer.linear.bias, -0.5)
    assert not layer(torch.zeros(sum(graph.sizes), 4, dtype=torch.float64), graph).any()


def test_nan_spreads_to_neighbours_only() -> None:
    """NaN is not hidden: the caller checks the output."""
    graph, layer = graph_of([1]), layer_of(1.0)
    features = torch.ones(sum(graph.sizes), 4, dtype=torch.float64)
    features[7] = math.nan
    spoilt = layer(features, graph).isnan().any(dim=1)
    assert torch.equal(spoilt, (graph.adjacency.to_dense() / graph.degree)[:, 7] > 0)

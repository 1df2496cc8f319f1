"""A zero-neighbour graph layer: some features look at the neighbours, the rest stay at their vertex (supplement 3.2, after GEOMetrics)."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import linear, pad

from pipeline.kernels.networks.graph import ChartGraph, Cut

ALIGNED = 16
"""Columns: a CPU multiplies matrices of 256 columns in two thirds of the time of the tables' 250."""


class _AverageAll(torch.autograd.Function):
    """Averages the first `mixed` columns over neighbours, then ReLU, all in place: a layer then keeps one array for the gradient."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, mean: Tensor, transposed: Tensor, mixed: int) -> Tensor:
        ctx.mixed = mixed
        ctx.mark_dirty(features)
        if mixed:
            features[:, :mixed] = _product(mean, features[:, :mixed])
        features.relu_()
        ctx.save_for_backward(features, transposed)
        return features

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None]:
        features, transposed = ctx.saved_tensors
        gradient = torch.ops.aten.threshold_backward(gradient, features, 0)  # a new array: gradients given may not be changed
        if ctx.mixed:
            gradient[:, : ctx.mixed] = _product(transposed, gradient[:, : ctx.mixed])
        return gradient, None, None, None


class _AverageOfSome(torch.autograd.Function):
    """The same for a `Cut`: of the rows that go in those that leave come out."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, mean: Tensor, transposed: Tensor, leaving: Tensor, mixed: int) -> Tensor:
        ctx.mixed, ctx.entering = mixed, len(features)
        kept = features.index_select(0, leaving)
        if mixed:
            kept[:, :mixed] = _product(mean, features[:, :mixed])
        kept.relu_()
        ctx.save_for_backward(kept, transposed, leaving)
        return kept

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None, None]:
        kept, transposed, leaving = ctx.saved_tensors
        gradient = torch.ops.aten.threshold_backward(gradient, kept, 0)
        spread = gradient.new_zeros(ctx.entering, gradient.shape[1])
        spread[leaving] = gradient
        if ctx.mixed:
            spread[:, : ctx.mixed] = _product(transposed, gradient[:, : ctx.mixed])
        return spread, None, None, None, None


def _product(matrix: Tensor, columns: Tensor) -> Tensor:
    """The matrix times columns, in the matrix's precision: sparse products know no half precision on a CPU."""
    with torch.autocast(columns.device.type, enabled=False):
        return (matrix @ columns.to(matrix.dtype)).to(columns.dtype)


def zero_neighbour(features: Tensor, weight: Tensor, bias: Tensor, graph: ChartGraph | Cut, mixed: int) -> Tensor:
    """(N, out) features from (N, in): mapped by weight (out, in) and bias (out,), the first `mixed` averaged over neighbours, ReLU.

    With a `Cut`, (n, out) from (m, in).
    """
    mapped = linear(features, weight, bias)
    averaged: Tensor
    if isinstance(graph, Cut):
        averaged = _AverageOfSome.apply(mapped, graph.mean, graph.transposed, graph.leaving, mixed)  # type: ignore[no-untyped-call]
    else:
        averaged = _AverageAll.apply(mapped, graph.mean, graph.transposed, mixed)  # type: ignore[no-untyped-call]
    return averaged


class ZeroNeighbourLayer(nn.Module):
    """A linear map of each vertex's features; the first floor(mixed · out_features) are averaged over neighbours; ReLU.

    Equal to the bit from run to run on a CPU with the same number of threads.

    Parameters
    ----------
    in_features, out_features
        Features of a vertex before and after.
    mixed
        Share of features that are averaged, 0 to 1; GEOMetrics has 1/3 and 1/10.
    """

    def __init__(self, in_features: int, out_features: int, mixed: float = 1 / 3):
        super().__init__()
        if not 0 <= mixed <= 1:
            raise ValueError(f"mixed is {mixed}, but it is a share of the features: 0 to 1")
        self.linear = nn.Linear(in_features, out_features)
        self.mixed = math.floor(mixed * out_features)

    def forward(self, features: Tensor, graph: ChartGraph) -> Tensor:
        """(N, out_features) from (N, in_features) of the graph's vertices.

        What is not finite spreads to the neighbours: `DeformationNetwork` lets no such input in, and trainings stop at such a loss.

        Raises
        ------
        ValueError
            Where the features do not fit the graph or the layer.
        """
        expected = graph.mean.shape[0], self.linear.in_features
        if tuple(features.shape) != expected:
            raise ValueError(f"features are {tuple(features.shape)}, but graph and layer take {expected}: vertices, features")
        return zero_neighbour(features, self.linear.weight, self.linear.bias, graph, self.mixed)

    def aligned(self, features: Tensor, graph: ChartGraph | Cut) -> Tensor:
        """The same for features that may have columns of zeros at their end, and with such columns up to a multiple of `ALIGNED`."""
        out_features, in_features = self.linear.weight.shape
        beyond = features.shape[1] - in_features, -out_features % ALIGNED
        if not any(beyond):
            return zero_neighbour(features, self.linear.weight, self.linear.bias, graph, self.mixed)
        weight, bias = pad(self.linear.weight, (0, beyond[0], 0, beyond[1])), pad(self.linear.bias, (0, beyond[1]))
        return zero_neighbour(features, weight, bias, graph, self.mixed)

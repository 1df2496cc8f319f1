"""Zero-neighbour layers and the graph convolution network made of them (supplement 3.2, after GEOMetrics; Tables 6-11)."""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from pipeline.kernels.networks.chart_graph import ChartGraph


class ZeroNeighbourLayer(nn.Module):
    """Map each vertex's features linearly, average the first of them over neighbours, and apply a ReLU.

    Parameters
    ----------
    in_features, out_features
        Features of a vertex before and after.
    mixed
        Share of the features that are averaged, 0 to 1; GEOMetrics has 1/3 and 1/10.
    """

    def __init__(self, in_features: int, out_features: int, mixed: float = 1 / 3) -> None:
        super().__init__()
        self.linear = nn.Linear(in_features, out_features)
        self.mixed = math.floor(mixed * out_features)

    def forward(self, features: Tensor, graph: ChartGraph) -> Tensor:
        """Compute the layer's output.

        Parameters
        ----------
        features
            (N, in_features).
        graph
            The neighbours of the N vertices.

        Returns
        -------
        (N, out_features). Values that are not finite spread to the neighbours.

        Raises
        ------
        ValueError
            The features do not fit the graph or the layer.
        """
        expected = sum(graph.sizes), self.linear.in_features
        if tuple(features.shape) != expected:
            raise ValueError(f"features are {tuple(features.shape)}; graph and layer take {expected}: vertices, features")
        weight, bias = self.linear.weight, self.linear.bias
        unmixed = linear(features, weight[self.mixed :], bias[self.mixed :])
        averaged = linear(features, weight[: self.mixed], bias[: self.mixed])
        return torch.cat([graph.average(averaged), unmixed], dim=1).relu_()


class GraphConvolutionNetwork(nn.Module):
    """Zero-neighbour layers, and a linear one that gives each vertex's displacement.

    Parameters
    ----------
    in_features
        Features of a vertex that go in.
    layers
        Layers in all, the linear one included; 2 at least.
    features
        Features of each layer but the last.
    mixed
        Share of the features that are averaged over neighbours.
    """

    def __init__(self, in_features: int, layers: int, features: int, mixed: float = 1 / 3) -> None:
        super().__init__()
        widths = [in_features, *[features] * (layers - 1)]
        self.hidden = nn.ModuleList(ZeroNeighbourLayer(before, after, mixed) for before, after in pairwise(widths))
        self.last = nn.Linear(features, 3)

    def forward(self, features: Tensor, graph: ChartGraph) -> Tensor:
        """Compute displacements (N, 3) of a graph's vertices from their features (N, in_features), in the unit of the positions."""
        for layer in self.hidden:
            features = layer(features, graph)
        with torch.autocast(features.device.type, enabled=False):  # half precision would move vertices in steps of a millimetre
            displacements: Tensor = self.last(features.to(self.last.weight.dtype))
        return displacements

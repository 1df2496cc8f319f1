"""Zero-neighbour layers and the graph convolution network made of them (supplement 3.2, after GEOMetrics; Tables 6-11)."""

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from pipeline.kernels.networks.chart_graph import ChartGraph


class ZeroNeighbourLayer(nn.Module):
    """Map each vertex's features linearly, average the first of them over neighbours, and apply a ReLU.

    `mixed` is the share of the features that are averaged, 0 to 1; GEOMetrics has 1/3 and 1/10.
    """

    def __init__(self, in_features: int, out_features: int, mixed: float = 1 / 3) -> None:
        super().__init__()
        self.linear = nn.Linear(in_features, out_features)
        self.mixed = math.floor(mixed * out_features)

    def forward(
        self,
        features: Tensor,  # (N, in_features)
        graph: ChartGraph,  # the neighbours of the N vertices
    ) -> Tensor:  # (N, out_features)
        """Compute the layer's output; values that are not finite spread to the neighbours."""
        expected = sum(graph.sizes), self.linear.in_features
        if tuple(features.shape) != expected:
            raise ValueError(f"features are {tuple(features.shape)}; graph and layer take {expected}: vertices, features")
        weight, bias = self.linear.weight, self.linear.bias
        unmixed = linear(features, weight[self.mixed :], bias[self.mixed :])
        averaged = linear(features, weight[: self.mixed], bias[: self.mixed])
        return torch.cat([graph.average(averaged), unmixed], dim=1).relu_()


class GraphConvolutionNetwork(nn.Module):
    """Zero-neighbour layers, and a linear one that gives each vertex's displacement.

    There are `layers` in all, the linear one included, 2 at least; each but the last has `features`, of which the share
    `mixed` is averaged over neighbours.
    """

    def __init__(self, in_features: int, layers: int, features: int, mixed: float = 1 / 3) -> None:
        super().__init__()
        widths = [in_features, *[features] * (layers - 1)]
        self.hidden = nn.ModuleList(ZeroNeighbourLayer(before, after, mixed) for before, after in pairwise(widths))
        self.last = nn.Linear(features, 3)

    def forward(self, features: Tensor, graph: ChartGraph) -> Tensor:
        """Compute displacements (N, 3) of a graph's vertices from their features (N, in_features)."""
        for layer in self.hidden:
            features = layer(features, graph)
        with torch.autocast(features.device.type, enabled=False):  # half precision would move vertices in steps of a millimetre
            displacements: Tensor = self.last(features.to(self.last.weight.dtype))
        return displacements

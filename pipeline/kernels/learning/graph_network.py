"""The graph network that moves vision charts: zero-neighbour layers, each with its ReLU, and a linear last one (Tables 6-11)."""

from __future__ import annotations

from itertools import pairwise
from typing import cast

import torch
from torch import Tensor, nn

from pipeline.kernels.learning.graph import ChartGraph
from pipeline.kernels.learning.zero_neighbour import ZeroNeighbourLayer


class GraphNetwork(nn.Module):
    """`layers` layers: zero-neighbour ones of `features` features, but the last, which gives three, only maps: no averages, no ReLU.

    Parameters
    ----------
    in_features
        Features of a vertex that go in.
    layers, features
        Layers in all, the last one included, and the features of each but the last.
    mixed
        Share of features that are averaged over neighbours.
    """

    def __init__(self, in_features: int, layers: int, features: int, mixed: float = 1 / 3):
        super().__init__()
        if layers < 2:
            raise ValueError(
                f"layers is {layers}, but a graph network has 2 at least: one that sees the neighbours, one that moves vertices"
            )
        self.in_features = in_features
        widths = [in_features, *[features] * (layers - 1)]
        self.hidden = nn.ModuleList(ZeroNeighbourLayer(*pair, mixed) for pair in pairwise(widths))
        self.last = nn.Linear(features, 3)

    def forward(self, features: Tensor, graph: ChartGraph) -> Tensor:
        """(N, 3) from the features (N, in_features) of the graph's vertices."""
        for layer in self.hidden:
            features = cast(ZeroNeighbourLayer, layer).aligned(features, graph)
        features = features[:, : self.last.in_features]
        with torch.autocast(features.device.type, enabled=False):  # half precision would move vertices in steps of a millimetre
            moved: Tensor = self.last(features.to(self.last.weight.dtype))
        return moved

"""The graph network that moves vision charts: zero-neighbour layers, each with its ReLU, and a linear last one (Tables 6-11)."""

from __future__ import annotations

from itertools import pairwise
from typing import cast

import torch
from torch import Tensor, nn

from pipeline.kernels.networks.graph import ChartGraph
from pipeline.kernels.networks.zero_neighbour import ZeroNeighbourLayer


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
        return self._moved(features)

    def of_vision(self, features: Tensor, graph: ChartGraph) -> Tensor:
        """(B, V, 3) of the vision vertices alone: what none of them depends on is not computed."""
        whole = max(0, len(self.hidden) - len(graph.cuts))
        for layer in self.hidden[:whole]:
            features = cast(ZeroNeighbourLayer, layer).aligned(features, graph)
        if not graph.cuts:
            return graph.of_vision(self._moved(features))
        cuts = graph.cuts[: len(self.hidden) - whole][::-1]
        features = features.index_select(0, cuts[0].entering)
        for layer, cut in zip(self.hidden[whole:], cuts, strict=True):
            features = cast(ZeroNeighbourLayer, layer).aligned(features, cut)
        return self._moved(features).reshape(len(graph.counts), graph.vision, 3)

    def _moved(self, features: Tensor) -> Tensor:
        features = features[:, : self.last.in_features]
        with torch.autocast(features.device.type, enabled=False):  # half precision would move vertices in steps of a millimetre
            moved: Tensor = self.last(features.to(self.last.weight.dtype))
        return moved

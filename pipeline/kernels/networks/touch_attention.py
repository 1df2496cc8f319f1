"""Attention of queries to touches: each query learns of all touches of its item, however far, and of what was believed there."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.kernels.networks.touch_points import SCALES, TouchPoints

HEADS = 4  # groups of features, each with its own weights of the touches
SHAPE_FEATURES = 7  # of a touched point: offset from the middle of its touch over the gel's width, normal, and this width
PLACE_FEATURES = 8  # of a touch: middle, mean normal, width of the gel, and the distance believed at the middle
PAIR_FEATURES = 5 + len(SCALES)  # of a query and a touch: offset, height above its plane, distance, and how close it is


@dataclass(frozen=True)
class Sites:
    """The touches of B items, padded to T of an item; in radii from the centre."""

    middles: Tensor  # (B, T, 3) means of touched points
    normals: Tensor  # (B, T, 3) unit
    keys: Tensor  # (B, T, features)
    present: Tensor  # (B, T) bool


class TouchAttention(nn.Module):
    """Weigh the touches of an item for each query, and tell it what the touches with weight say.

    A touch is described by where it is, the shape felt there, and what the network believed of its middle before it knew of touches: how
    far off this belief was says how far off it is nearby, and on the far side of the object.
    """

    def __init__(self, hidden: int, features: int) -> None:
        super().__init__()
        self.shape, self.place = nn.Linear(SHAPE_FEATURES, features), nn.Linear(PLACE_FEATURES + features + hidden, features)
        self.pair, self.query = nn.Linear(PAIR_FEATURES, features), nn.Linear(hidden, features)
        self.score, self.told = nn.Linear(features, HEADS), nn.Linear(features, hidden)

    def middles(self, touches: TouchPoints) -> Tensor:  # (B, T, 3)
        """Compute the mean point of each touch; 0 for padding."""
        return self._means(touches, touches.points)

    def sites(
        self,
        touches: TouchPoints,  # with widths
        hidden: Tensor,  # (B, T, hidden) what the network makes of the middles without touches
        distances: Tensor,  # (B, T) and the distances that it predicts there, over the band
    ) -> Sites:
        """Describe touches, once for all queries."""
        assert touches.widths is not None
        middles, normals = self.middles(touches), functional.normalize(self._means(touches, touches.normals), dim=2)
        widths = self._means(touches, touches.widths[..., None])
        items, points = torch.nonzero(touches.touched, as_tuple=True)
        at = touches.sites[items, points]
        offsets = (touches.points[items, points] - middles[items, at]) / widths[items, at]
        felt = self.shape(torch.cat([offsets, touches.normals[items, points], widths[items, at]], dim=1)).relu()
        row = (items * middles.shape[1] + at)[:, None].expand_as(felt)
        shapes = felt.new_zeros(widths[..., 0].numel(), felt.shape[1]).scatter_reduce(0, row, felt, "amax").view(*widths.shape[:2], -1)
        keys = self.place(torch.cat([middles, normals, widths, distances[..., None], shapes, hidden.relu()], dim=2))
        return Sites(middles, normals, keys, widths[..., 0] > 0)

    def forward(self, hidden: Tensor, queries: Tensor, sites: Sites) -> Tensor:
        """Compute what touches say to queries (B, N, 3), radii, of which the network knows `hidden` (B, N, hidden): (B, N, hidden)."""
        offsets = queries[:, :, None] - sites.middles[:, None]  # (B, N, T, 3)
        heights, distances = (offsets * sites.normals[:, None]).sum(dim=3, keepdim=True), offsets.norm(dim=3, keepdim=True)
        pairs = torch.cat([offsets, heights, distances, *(torch.exp(-distances / scale) for scale in SCALES)], dim=3)
        known = (self.pair(pairs) + sites.keys[:, None] + self.query(hidden.relu())[:, :, None]).relu()  # (B, N, T, features)
        scores = self.score(known).masked_fill(~sites.present[:, None, :, None], -torch.inf)
        weights = functional.pad(scores, (0, 0, 0, 1)).softmax(dim=2)[:, :, :-1]  # the last touch is none: a query may need no other
        said = (weights[..., None] * known.unflatten(3, (HEADS, -1))).sum(dim=2)  # (B, N, HEADS, features / HEADS)
        told: Tensor = self.told(said.flatten(2))
        return told

    @staticmethod
    def _means(touches: TouchPoints, values: Tensor) -> Tensor:  # (B, T, C)
        """Average values (B, P, C) over the points of each touch."""
        items, points = torch.nonzero(touches.touched, as_tuple=True)
        count = int(touches.sites.max()) + 1
        rows = items * count + touches.sites[items, points]
        sums = values.new_zeros(len(values) * count, values.shape[2]).index_add(0, rows, values[items, points])
        means = sums / torch.bincount(rows, minlength=len(sums)).clamp(min=1)[:, None]
        return means.view(len(values), count, -1)

"""Touched points as networks take them, and what a query is told of the nearest touched point and the nearest one known to be outside."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from pipeline.kernels.metrics.chamfer import SearchCloud
from pipeline.kernels.touch.touched_points import Touch

NEAREST_POINT_FEATURES = 9  # offset, normal, height above the tangent plane, and how close the point is, at two scales
TOUCH_FEATURES = 2 * NEAREST_POINT_FEATURES  # of the nearest point that was touched, and of the nearest known to be outside
POINT_FEATURES = 7  # position, normal, and whether it was touched; networks of gels have the gel's width too, here and above
SCALES = (0.04, 0.2)  # radii of an object, 1 and 5 cm: closeness is exp(-distance / scale)


@dataclass(frozen=True)
class TouchPoints:
    """What sensors feel of B items, padded to P points, the most of an item; padding is neither touched nor outside."""

    points: Tensor  # (B, P, 3) world, m; in a network, radii from the centre
    normals: Tensor  # (B, P, 3) unit normals, away from the object
    widths: Tensor | None  # (B, P) of the gel that each point is of, in the unit of the points; None in a network that is not given it
    touched: Tensor  # (B, P) bool: points that were touched
    outside: Tensor  # (B, P) bool: points that are known to be free
    sites: Tensor  # (B, P) int64: which touch of its item each touched point is of, counted from 0; -1 for others

    @property
    def present(self) -> Tensor:  # (B, P) bool
        """Find the entries that are no padding."""
        return self.touched | self.outside

    @property
    def point_features(self) -> Tensor:
        """Describe each point: (B, P, `POINT_FEATURES`, or one more)."""
        widths = [] if self.widths is None else [self.widths]
        return torch.cat([self.points, self.normals, *(values.to(self.points)[..., None] for values in (self.touched, *widths))], dim=2)

    def features_at(self, queries: Tensor) -> tuple[Tensor, Tensor]:  # (B, N, `TOUCH_FEATURES`, or two more), (B, N) int64
        """Compute features of queries (B, N, 3), radii, zeros where no point counts, and the numbers of the nearest touched points."""
        if not self.points.shape[1]:
            count = TOUCH_FEATURES + 2 * (self.widths is not None)
            return queries.new_zeros(*queries.shape[:2], count), queries.new_zeros(queries.shape[:2], dtype=torch.int64)
        nearest = [self._nearest(queries, clouds) for clouds in self._clouds]
        pairs = zip(nearest, (self.touched, self.outside), strict=True)
        return torch.cat([self._features(queries, *pair) for pair in pairs], dim=2), nearest[0]

    @cached_property
    def _clouds(self) -> list[list[tuple[Tensor, SearchCloud | None]]]:
        """Per side, touched and outside, and item: the numbers of the points there, and their cloud."""
        sides = [[torch.nonzero(counted)[:, 0] for counted in among] for among in (self.touched, self.outside)]
        return [
            [(numbers, SearchCloud(points[numbers]) if len(numbers) else None) for points, numbers in zip(self.points, side, strict=True)]
            for side in sides
        ]

    def _nearest(self, queries: Tensor, clouds: Sequence[tuple[Tensor, SearchCloud | None]]) -> Tensor:
        nearest = queries.new_zeros(queries.shape[:2], dtype=torch.int64)
        for item, (numbers, cloud) in enumerate(clouds):
            if cloud is not None:
                nearest[item] = numbers[cloud.nearest(queries[item])]
        return nearest

    def _features(self, queries: Tensor, nearest: Tensor, among: Tensor) -> Tensor:
        at = nearest[..., None].expand(-1, -1, 3)
        offset, normal = queries - self.points.gather(1, at), self.normals.gather(1, at)
        height = (offset * normal).sum(dim=2, keepdim=True)
        distance = offset.norm(dim=2, keepdim=True)
        widths = [] if self.widths is None else [self.widths.gather(1, nearest)[..., None]]
        features = torch.cat([offset, normal, height, *(torch.exp(-distance / scale) for scale in SCALES), *widths], dim=2)
        return features * among.any(dim=1)[:, None, None]


def heights_above_touches(
    features: Tensor,  # (..., `TOUCH_FEATURES`) of the queries
    reach: Tensor,  # (...) distance at which a height's weight is 1/e, radii
    *,
    finger: float,  # depth of the finger above the plane, radii: height up to it adds nothing to the distance
    below: float,  # depth below the plane at which a height's weight is 1/e, radii: the object may be thin
) -> tuple[Tensor, Tensor]:  # heights (...), radii; weights (...) exp(-(distance / reach)⁴), zeros where nothing was touched
    """Compute the heights of queries above the tangent planes of the nearest touched points; the object cannot be in the finger."""
    offset, normal, height = features[..., :3], features[..., 3:6], features[..., 6]
    across = offset.square().sum(dim=-1) - height.square()
    along = (height - finger).clamp(min=0) / reach + height.clamp(max=0) / below
    return height, torch.exp(-((across / reach**2 + along.square()) ** 2)) * normal.any(dim=-1)


def pad_touches(items: Sequence[Sequence[Touch]], like: Tensor) -> TouchPoints:
    """Pad what is felt of each of B items to the most points of an item, with the device and type of `like`; world, m."""
    most = max((sum(len(touch.points) + len(touch.free) for touch in touches) for touches in items), default=0)
    points, normals = np.zeros((2, len(items), most, 3), np.float32)
    widths, is_touched, is_free = np.zeros((len(items), most), np.float32), *np.zeros((2, len(items), most), bool)
    sites = np.full((len(items), most), -1)
    for item, touches in enumerate(items):
        start = site = 0
        for touch in touches:
            for flags, cloud, directions in ((is_touched, touch.points, touch.normals), (is_free, touch.free, touch.free_normals)):
                rows = slice(start, start := start + len(cloud))
                points[item, rows], normals[item, rows], widths[item, rows], flags[item, rows] = cloud, directions, touch.width, True
            sites[item, is_touched[item] & (sites[item] < 0)] = site
            site += touch.touched
    felt = [torch.from_numpy(values).to(like) for values in (points, normals, widths)]
    return TouchPoints(*felt, *(torch.from_numpy(values).to(like.device) for values in (is_touched, is_free, sites)))

"""Features of touch charts for implicit networks: of the nearest touched point, and of the nearest point that is known to be outside."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from pipeline.kernels.metrics.chamfer import SearchCloud

NEAREST_POINT_FEATURES = 9  # offset, normal, height above the tangent plane, and how close the point is, at two scales
TOUCH_FEATURES = 2 * NEAREST_POINT_FEATURES  # of the nearest point that was touched, and of the nearest known to be outside
POINT_FEATURES = 7  # position, normal, and whether it was touched
SCALES = (0.04, 0.2)  # radii of an object, 1 and 5 cm: closeness is exp(-distance / scale)


@dataclass(frozen=True)
class TouchPoints:
    """The vertices of the touch charts of B items, padded to P, the most of an item; padding is neither touched nor outside."""

    points: Tensor  # (B, P, 3) in radii from the centre
    normals: Tensor  # (B, P, 3) unit normals, away from the object
    touched: Tensor  # (B, P) bool: points that were touched
    outside: Tensor  # (B, P) bool: points of sensors that touched nothing

    @property
    def present(self) -> Tensor:  # (B, P) bool
        """Find the entries that are no padding."""
        return self.touched | self.outside

    @property
    def point_features(self) -> Tensor:
        """Describe each point: (B, P, `POINT_FEATURES`)."""
        return torch.cat([self.points, self.normals, self.touched.to(self.points)[..., None]], dim=2)

    def features_at(self, queries: Tensor) -> tuple[Tensor, Tensor]:  # (B, N, `TOUCH_FEATURES`), (B, N) int64
        """Compute features of queries (B, N, 3), radii, zeros where no point counts, and the numbers of the nearest touched points."""
        if not self.points.shape[1]:
            return queries.new_zeros(*queries.shape[:2], TOUCH_FEATURES), queries.new_zeros(queries.shape[:2], dtype=torch.int64)
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
        features = torch.cat([offset, normal, height, *(torch.exp(-distance / scale) for scale in SCALES)], dim=2)
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


def chart_normals(vertices: Tensor) -> Tensor:
    """Compute unit normals (T, S, 3), away from the object, at the vertices (T, S, 3) of touch charts; zeros without area."""
    side = round(vertices.shape[1] ** 0.5)
    if not len(vertices):
        return vertices
    rows, columns = torch.gradient(vertices.reshape(-1, side, side, 3), dim=(1, 2))
    across = torch.linalg.cross(rows, columns)  # -z of the sensor, which looks at the object
    return torch.nn.functional.normalize(across, dim=-1, eps=1e-20).reshape(vertices.shape)


def touches_by_item(vertices: Tensor, touched: Tensor, counts: Sequence[int]) -> TouchPoints:  # P is S times the most charts
    """Group the touch charts (T, S, 3), radii from the centre, of which some touched (T,), by item, with counts per item."""
    item = torch.repeat_interleave(torch.arange(len(counts)), torch.tensor(counts))
    slot = torch.cat([torch.arange(0), *map(torch.arange, counts)])
    where = torch.stack([item, slot]).to(vertices.device)

    def padded_by_item(charts: Tensor) -> Tensor:
        """Pad (T, S, ...) values per item with zeros: (B, P, ...)."""
        padded = charts.new_zeros(len(counts), max(counts), *charts.shape[1:])
        return padded.index_put((where[0], where[1]), charts).flatten(1, 2)

    flags = touched[:, None].expand(vertices.shape[:2])
    return TouchPoints(padded_by_item(vertices), padded_by_item(chart_normals(vertices)), padded_by_item(flags), padded_by_item(~flags))

"""Features of touch charts for implicit networks: the nearest touched point, and the nearest point known to be outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from pipeline.kernels.metrics.chamfer import SearchCloud

NEAREST_POINT_FEATURES = 9
"""Features of the nearest point: offset and normal, the height above its tangent plane, and how close it is, at two scales."""
TOUCH_FEATURES = 2 * NEAREST_POINT_FEATURES
"""Features per query: of the nearest point that was touched, and of the nearest one that is known to be outside."""
POINT_FEATURES = 7
"""Numbers per point: position, normal, and whether it was touched."""
SCALES = (0.04, 0.2)
"""Radii of an object, 1 and 5 cm: closeness is exp(-distance / scale)."""


@dataclass(frozen=True)
class TouchPoints:
    """The vertices of an item's touch charts: P points with normals.

    Attributes
    ----------
    points
        (P, 3) in radii from the centre.
    normals
        (P, 3) unit normals, away from the object.
    touched
        (P,) bool: the others are of sensors that touched nothing, so that they lie outside.
    """

    points: Tensor
    normals: Tensor
    touched: Tensor

    @property
    def point_features(self) -> Tensor:
        """Describe each point: (P, `POINT_FEATURES`)."""
        return torch.cat([self.points, self.normals, self.touched.to(self.points)[:, None]], dim=1)

    def features_at(self, queries: Tensor) -> Tensor:
        """Compute features (N, `TOUCH_FEATURES`) of queries (N, 3), radii from the centre; zeros where there is no such point."""
        return torch.cat([_nearest(queries, *side) for side in self._sides], dim=1)

    @cached_property
    def _sides(self) -> tuple[tuple[SearchCloud | None, Tensor], ...]:
        """The touched points, and those that are known to be outside: searchable, with their normals; None where there is none."""
        masks = (self.touched, ~self.touched)
        return tuple((SearchCloud(self.points[mask]) if bool(mask.any()) else None, self.normals[mask]) for mask in masks)


def _nearest(queries: Tensor, target: SearchCloud | None, normals: Tensor) -> Tensor:
    if target is None:
        return queries.new_zeros(len(queries), NEAREST_POINT_FEATURES)
    nearest = target.nearest(queries)
    offset, normal = queries - target.points[nearest], normals[nearest]
    height = (offset * normal).sum(dim=1, keepdim=True)
    distance = offset.norm(dim=1, keepdim=True)
    return torch.cat([offset, normal, height, *(torch.exp(-distance / scale) for scale in SCALES)], dim=1)


def heights_above_touches(felt: Tensor, reach: float, finger: float) -> tuple[Tensor, Tensor]:
    """Compute the heights of queries above the tangent planes of the touched points nearest to them.

    Parameters
    ----------
    felt
        (..., `TOUCH_FEATURES`) features of the queries.
    reach
        Distance at which a height's weight is 1/e, radii.
    finger
        Depth of the finger above the plane, radii: the object is not there, so height up to it adds nothing to the distance.

    Returns
    -------
    Heights (...), radii, and their weights (...): exp(-(distance / reach)⁴), zeros where nothing was touched.
    """
    offset, normal, height = felt[..., :3], felt[..., 3:6], felt[..., 6]
    beyond = height - height.clamp(0, finger)
    squared = offset.square().sum(dim=-1) - height.square() + beyond.square()
    return height, torch.exp(-((squared / reach**2) ** 2)) * normal.any(dim=-1)


def chart_normals(vertices: Tensor) -> Tensor:
    """Compute unit normals at the vertices of touch charts, away from the object.

    Parameters
    ----------
    vertices
        (T, S, 3) charts of S = side² vertices, row by row as `chart_square` has them.

    Returns
    -------
    (T, S, 3); zeros where a chart has no area.
    """
    side = round(vertices.shape[1] ** 0.5)
    if not len(vertices):
        return vertices
    rows, columns = torch.gradient(vertices.reshape(-1, side, side, 3), dim=(1, 2))
    across = torch.linalg.cross(rows, columns)  # -z of the sensor, which looks at the object
    return torch.nn.functional.normalize(across, dim=-1, eps=1e-20).reshape(vertices.shape)


def split_touches(vertices: Tensor, touched: Tensor, counts: Sequence[int]) -> list[TouchPoints]:
    """Split the touch charts of a batch by item.

    Parameters
    ----------
    vertices
        (T, S, 3) of all items' charts, radii from the centre.
    touched
        (T,) bool, whether each chart touched the object.
    counts
        Charts of each of B items.

    Returns
    -------
    The points of each item.
    """
    normals, flags = chart_normals(vertices), touched[:, None].expand(vertices.shape[:2])
    split = (torch.split(part, list(counts)) for part in (vertices, normals, flags))
    return [
        TouchPoints(points.reshape(-1, 3), normal.reshape(-1, 3), flag.reshape(-1)) for points, normal, flag in zip(*split, strict=True)
    ]

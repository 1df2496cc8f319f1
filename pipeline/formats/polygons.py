"""Cut polygons into triangles; concave ones by ears, as they are drawn."""

from __future__ import annotations

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

TURN = 1e-6
"""Sine of the turn at a corner, against the polygon's sense, from which it counts as concave."""


def triangulate(
    corners: NDArray[np.int64],  # (C,) vertices of all polygons, one polygon after the other
    sizes: NDArray[np.int64],  # (P,) corners of each polygon
    vertices: NDArray[np.float64],  # (V, 3)
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cut polygons into triangles.

    Returns
    -------
    triangles
        (T, 3) indices into `corners`, in the order of the polygons. Polygons of fewer than three corners give none.
    polygon
        (T,) the polygon of each triangle.
    """
    firsts = np.cumsum(sizes) - sizes
    pieces, numbers = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for size in np.unique(sizes[sizes >= 3]):
        polygons = np.flatnonzero(sizes == size)
        fan = np.stack([np.zeros(size - 2, np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
        cut = np.tile(fan, (len(polygons), 1, 1))
        if size > 3:
            positions = vertices[corners[firsts[polygons, None] + np.arange(size)]]
            for place in np.flatnonzero(is_concave(positions)):
                ears = ear_clip(positions[place])
                cut[place] = ears if len(ears) == size - 2 else fan
        pieces.append((firsts[polygons, None, None] + cut).reshape(-1, 3))
        numbers.append(np.repeat(polygons, size - 2))
    polygon = np.concatenate(numbers)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(pieces)[order], polygon[order]


def is_concave(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether polygons (P, N, 3) turn against their own sense at a corner."""
    sides = np.roll(corners, -1, axis=1) - corners
    lengths, normal = np.linalg.norm(sides, axis=2), _normal(corners)
    turns = (np.cross(np.roll(sides, 1, axis=1), sides) * normal[:, None]).sum(axis=2)
    limit = TURN * lengths * np.roll(lengths, 1, axis=1) * np.linalg.norm(normal, axis=1)[:, None]
    return np.asarray((turns < -limit).any(axis=1))


def ear_clip(corners: NDArray[np.float64]) -> NDArray[np.integer]:
    """Cut a polygon (N, 3), as seen along its normal, into triangles (T, 3) of its corners."""
    normal, sides = _normal(corners), np.roll(corners, -1, axis=0) - corners
    across = sides[np.linalg.norm(sides, axis=1).argmax()]
    plane = np.stack([across / np.linalg.norm(across), np.cross(normal, across) / np.linalg.norm(np.cross(normal, across))], axis=1)
    return np.asarray(
        mapbox_earcut.triangulate_float64(np.ascontiguousarray(corners @ plane), np.array([len(corners)], np.uint32))
    ).reshape(-1, 3)


def _normal(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute twice the area of polygons (…, N, 3) as vectors (…, 3)."""
    spokes = corners - corners[..., :1, :]
    return np.asarray(np.cross(spokes, np.roll(spokes, -1, axis=-2)).sum(axis=-2))

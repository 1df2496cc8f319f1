"""Points drawn area-uniformly from triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import face_cross_products


def sample_triangles(triangles: NDArray[np.float64], count: int, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Draw `count` points from `triangles` (F, 3, 3), each place equally likely.

    Returns the points (count, 3), in the triangles' unit and frame, and the face (count,) of each. A face is drawn with
    its share of the area, then a point in it by folding the unit square over its diagonal (Osada et al., Shape
    Distributions, 2002, is the same up to a square root).

    A triangle without area is never drawn. A point lies on its triangle to within 8 units in the last place of the
    triangle's largest coordinate. Triangles may be 1e-75 to 1e75 units large: float64 must hold the square of an area.

    Raises
    ------
    ValueError
        A corner is NaN or infinite, or no triangle has an area.
    """
    if not np.isfinite(triangles).all():
        raise ValueError(f"{(~np.isfinite(triangles)).any(axis=(1, 2)).sum()} of {len(triangles)} triangles have NaN or infinite corners")
    cumulative = np.cumsum(np.linalg.norm(face_cross_products(triangles), axis=1))
    if not (len(cumulative) and cumulative[-1] >= np.finfo(np.float64).tiny):
        raise ValueError(f"none of the {len(triangles)} triangles has an area to draw points from")
    # random() is at most 1 - 2^-53, and no normal number times that rounds to itself: the end is never reached
    face = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
    u, v = rng.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u)[:, None], np.where(fold, 1 - v, v)[:, None]
    corner = triangles[face]
    points = corner[:, 0] + u * (corner[:, 1] - corner[:, 0]) + v * (corner[:, 2] - corner[:, 0])
    return points, face

"""Area-uniform sampling of points on triangles.

Valid range: triangles from 1e-9 to 1e9 units large, of any shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import face_cross_products


def sample_triangles(triangles: NDArray[np.float64], count: int, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Draw points area-uniformly from triangles.

    Parameters
    ----------
    triangles
        (F, 3, 3) float64 corner positions.
    count
        Number of points.
    rng
        Source of randomness.

    Returns
    -------
    points
        (count, 3) float64, unit and frame of the triangles; on its triangle to within 8 units in the last place of the largest
        coordinate.
    face
        (count,) the triangle of each point; a triangle without area is never drawn.

    Raises
    ------
    InvalidInput
        A corner is NaN or infinite, or no triangle has an area.

    Notes
    -----
    A face is drawn with its share of the area, then a point in it by folding the unit square over its diagonal (Osada et al., Shape
    Distributions, 2002, with the fold in place of their square root).
    """
    if not np.isfinite(triangles).all():
        bad = (~np.isfinite(triangles)).any(axis=(1, 2)).sum()
        raise InvalidInput(f"{bad} of {len(triangles)} triangles have NaN or infinite corners; repair the mesh")
    cumulative = np.cumsum(np.linalg.norm(face_cross_products(triangles), axis=1))
    if not (len(cumulative) and cumulative[-1] > 0):
        raise InvalidInput(f"none of the {len(triangles)} triangles has an area to draw points from")
    # random() is at most 1 - 2^-53, and no normal number times that rounds to itself: the end is never reached
    face = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
    u, v = rng.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u)[:, None], np.where(fold, 1 - v, v)[:, None]
    corner = triangles[face]
    points = corner[:, 0] + u * (corner[:, 1] - corner[:, 0]) + v * (corner[:, 2] - corner[:, 0])
    return points, face

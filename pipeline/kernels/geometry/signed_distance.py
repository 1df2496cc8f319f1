"""Signed distances from points in space to a mesh, and the points at which they are worth knowing."""

from __future__ import annotations

import igl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput

Float64Array = NDArray[np.float64]

INSIDE = 0.5
"""Size of the winding number above which a point is inside: a closed mesh has 1 there, or -1, one with small holes nearly as much."""


def signed_distances(points: Float64Array, vertices: Float64Array, faces: NDArray[np.integer]) -> Float64Array:
    """Compute signed distances to a mesh: positive outside, negative inside.

    Parameters
    ----------
    points
        (N, 3) finite, m.
    vertices, faces
        (V, 3) finite, m; (F, 3), F at least 1, all wound outwards or all inwards.

    Returns
    -------
    (N,) m. Inside, where parts of the mesh overlap, it is the distance to the nearest face of any part: no more than that to the surface of
    the whole.

    Raises
    ------
    InvalidInput
        There is no face.

    Notes
    -----
    The generalised winding number (Jacobson et al., 2013; Barill et al., 2018) decides on the side, so a mesh need not be closed. Both
    sides of an open sheet are outside.
    """
    if not len(faces):
        raise InvalidInput("a mesh without faces has neither surface nor inside")
    soup = np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64)
    asked = np.ascontiguousarray(points)
    distances = np.sqrt(igl.point_mesh_squared_distance(asked, *soup)[0])
    return np.asarray(np.where(np.abs(igl.fast_winding_number(*soup, asked)) > INSIDE, -distances, distances))


def draw_around(
    surface: Float64Array, count: int, rng: np.random.Generator, *, near: float, spread: tuple[float, float], reach: float
) -> Float64Array:
    """Draw points in space: some near a surface, the others all over the cube around it.

    Parameters
    ----------
    surface
        (P, 3) points of the surface, m.
    count
        Points to draw.
    rng
        Draws them.
    near
        Share of the points that are near: a point of the surface, moved along each axis by normal deviates of one standard deviation.
    spread
        Least and largest standard deviation, m; each point's is between them, uniform in its logarithm.
    reach
        Half the side of the cube around the middle of the surface's bounding box, m.

    Returns
    -------
    (count, 3) m, in random order: the first of them are a fair sample.
    """
    close = round(near * count)
    least, most = np.log(spread).tolist()
    deviation = np.exp(rng.uniform(least, most, (close, 1)))
    beside = surface[rng.integers(len(surface), size=close)] + deviation * rng.normal(size=(close, 3))
    middle = (surface.min(axis=0) + surface.max(axis=0)) / 2
    anywhere = middle + rng.uniform(-reach, reach, (count - close, 3))
    return rng.permutation(np.concatenate([beside, anywhere]))

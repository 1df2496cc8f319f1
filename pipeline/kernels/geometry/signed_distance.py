"""Distances from points to a mesh, and points drawn around it."""

from __future__ import annotations

import igl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Points

INSIDE_WINDING = 0.5
"""Size of the winding number above which a point is inside: a closed mesh has 1 there, or -1, one with small holes nearly as much."""


def signed_distances(points: Points, vertices: Points, faces: NDArray[np.integer]) -> Points:
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
    arrays = np.ascontiguousarray(points), np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64)
    distances = np.sqrt(igl.point_mesh_squared_distance(*arrays)[0])
    return np.asarray(np.where(is_inside(*arrays), -distances, distances))


def is_inside(points: Points, vertices: Points, faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Find the points inside a surface, by the size of the generalised winding number.

    Parameters
    ----------
    points
        (N, 3) finite, m.
    vertices, faces
        (V, 3) finite, m; (F, 3), F at least 1. Parts that are turned inside out count as inside too.

    Returns
    -------
    (N,) bool.
    """
    winding = igl.fast_winding_number(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64), np.ascontiguousarray(points))
    return np.asarray(np.abs(winding) > INSIDE_WINDING)


def rms_distance_to_surface(points: Points, vertices: Points, faces: NDArray[np.integer]) -> float:
    """Compute the root of the mean squared distance from points to a surface.

    Parameters
    ----------
    points
        (n, 3) finite; n at least 1.
    vertices
        (V, 3) finite, in the points' unit.
    faces
        (F, 3) triangles; F at least 1. They may be slivers, segments or points.

    Returns
    -------
    The distance, to the nearest point of a triangle, within 1e-13 of the largest coordinate. Beside slivers libigl's distance is too large,
    by a millionth of their length at an aspect of 1e6, and by up to a tenth of it beyond 1e8.

    Raises
    ------
    InvalidInput
        There is no point or no face, or something is NaN or infinite.
    """
    if not len(points) or not len(faces):
        raise InvalidInput(f"{len(points)} points and {len(faces)} faces: a distance needs at least one of each")
    if not (np.isfinite(points).all() and np.isfinite(vertices).all()):
        raise InvalidInput("points or vertices hold NaN or infinity: nothing has a distance from them")
    arrays = (np.ascontiguousarray(points), np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64))
    return float(np.sqrt(np.mean(igl.point_mesh_squared_distance(*arrays)[0])))


def sample_around_surface(
    surface: Points, count: int, rng: np.random.Generator, *, near: float, spread: tuple[float, float], reach: float
) -> Points:
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

"""The distance from points to a triangle surface."""

from __future__ import annotations

import igl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput


def rms_distance_to_surface(points: NDArray[np.float64], vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> float:
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
        raise InvalidInput(f"{len(points)} points, {len(faces)} faces: a distance takes one of each at least")
    if not (np.isfinite(points).all() and np.isfinite(vertices).all()):
        raise InvalidInput("points or vertices hold NaN or infinity: nothing has a distance from them")
    arrays = (np.ascontiguousarray(points), np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64))
    return float(np.sqrt(np.mean(igl.point_mesh_squared_distance(*arrays)[0])))

"""One closed, smooth mesh of a surface that was seen, or guessed, and patches of it that were touched."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import is_watertight
from pipeline.kernels.geometry.surface_attachment import attach_points
from pipeline.kernels.geometry.surface_wrapping import Faces, Points, smooth_mesh, vertex_normals, wrap_surface

RESOLUTION = 128
"""Edges of the mesh along the longest side of the surface's box: 4 mm of an object of half a metre."""
TOLERANCE = 4e-4
"""m: distance from touched places to the mesh, at most; half of what is promised, for files hold float32."""
CRUMPLES = 4
"""Rounds of Taubin's filter on the surface as it is given, which flatten what is as short as its own edges."""
RIDGES = 100
"""Rounds on the closed mesh, for what the grid leaves."""


def closed_surface(
    vertices: Points, faces: Faces, charts: NDArray[np.floating], chart_faces: Faces, *, resolution: int = RESOLUTION
) -> tuple[Points, Faces]:
    """Make one closed, smooth mesh that goes through what was touched.

    Parameters
    ----------
    vertices, faces
        (V, 3) m and (F, 3): a surface that may be crumpled, open, or cross itself.
    charts
        (K, S, 3) touch charts, m, in the same frame; K may be 0.
    chart_faces
        (G, 3) the faces of each, wound so that normals point into the object, as the sensor's do.
    resolution
        Edges of the mesh along the longest side of the surface's box.

    Returns
    -------
    Vertices and faces: one part, each edge in two faces, normals outwards. Every vertex of the charts is within 0.5 mm of it, however far
    the surface was from there: touches are believed, and a bulge leads to them.

    Raises
    ------
    InvalidInput
        A vertex is NaN or infinite, or the surface has no extent.
    """
    used = vertices[np.unique(faces)]
    if not len(used) or not np.isfinite(used).all() or not (extent := float(np.ptp(used, axis=0).max())) > 0:
        raise InvalidInput(f"a surface of {len(faces)} faces has vertices that are NaN or infinite, or no extent: nothing closes it")
    spacing = extent / resolution
    if is_watertight(faces):  # else its rims would shrink
        vertices = smooth_mesh(vertices, faces, CRUMPLES)
    closed, sides = wrap_surface(vertices, faces, spacing)
    closed = smooth_mesh(closed, sides, RIDGES)
    normals = np.zeros(charts.shape)
    for number, chart in enumerate(charts):
        normals[number] = -vertex_normals(chart, chart_faces)
    points = charts.reshape(-1, 3).astype(np.float64)
    return attach_points(closed, sides, points, normals.reshape(-1, 3), spacing=spacing, tolerance=TOLERANCE)

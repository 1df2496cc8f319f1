"""Shading normals of a mesh: smooth across gentle edges, sharp across creases, whatever the winding.

Valid range: meshes from 1 µm to 1 km large, within 100 m of the origin; the error of a normal grows with offset over size.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import check_coordinates, face_cross_products
from pipeline.kernels.geometry.mesh_cleaning import number_positions
from pipeline.kernels.geometry.transforms import unit_vectors

CREASE = np.deg2rad(40.0)  # rad: faces that meet at more show an edge; a 12-sided cylinder looks round, a box does not
MAX_NEIGHBOURS = 64  # more faces meet at the hub of a fan (a cap, a cone's tip): its faces keep their own normals
PAIRS_PER_CHUNK = 1_000_000  # pairs of neighbouring corners processed together: about 100 MB


def corner_normals(vertices: Array, faces: NDArray[np.int32]) -> Array:
    """Compute a unit normal for every corner of every face, (F, 3, 3), on the side to which the face is wound.

    A corner's normal is the mean, weighted by the angle at the vertex, of the normals of those faces around its position that make less
    than `CREASE` with its own face. Faces wound the other way count as if turned over. A face without area has the normal +z and no
    influence on its neighbours. The normal of a sliver of aspect a has an error of up to 8 a units in the last place.
    """
    check_coordinates(vertices, "vertices")
    triangles = vertices[faces]  # (F, 3, 3)
    normal = unit_vectors(face_cross_products(triangles))
    has_area = normal.any(axis=1, keepdims=True)
    normal_of = np.repeat(np.where(has_area, normal, [0.0, 0.0, 1.0]), 3, axis=0)  # (3F, 3), one row per corner
    weighted = normal_of * (_corner_angles(triangles) * has_area).reshape(-1, 1)

    position = number_positions(vertices)[faces].reshape(-1)  # (3F,)
    order = np.argsort(position, kind="stable")
    count = np.bincount(position)
    first = np.cumsum(count) - count

    smooth = normal_of.copy()
    corners = order[count[position[order]] <= MAX_NEIGHBOURS]
    cuts = np.flatnonzero(np.diff(np.cumsum(count[position[corners]]) // PAIRS_PER_CHUNK)) + 1
    for chunk in filter(len, np.split(corners, cuts)):
        neighbours = count[position[chunk]]
        starts = np.cumsum(neighbours) - neighbours
        rank = np.arange(neighbours.sum()) - np.repeat(starts, neighbours)
        own, other = np.repeat(chunk, neighbours), order[np.repeat(first[position[chunk]], neighbours) + rank]  # (P,) pairs
        cosine = np.einsum("ij,ij->i", normal_of[own], normal_of[other])
        sign = np.where(np.abs(cosine) > np.cos(CREASE), np.sign(cosine), 0.0)
        smooth[chunk] = np.add.reduceat(weighted[other] * sign[:, None], starts)
    smooth = np.where(smooth.any(axis=1, keepdims=True), unit_vectors(smooth), normal_of)
    return smooth.reshape(-1, 3, 3)


def _corner_angles(triangles: Array) -> Array:
    """Compute the angle at every corner, (F, 3) rad."""
    ahead = np.roll(triangles, -1, axis=1) - triangles
    behind = np.roll(triangles, 1, axis=1) - triangles
    cross = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.asarray(np.arctan2(cross, np.einsum("fci,fci->fc", ahead, behind)))

"""Normals to shade a mesh with: smooth across gentle edges, sharp across creases, whatever way its faces are wound."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import face_vectors

CREASE = np.deg2rad(40.0)
"""Faces that meet at a greater angle show an edge: it keeps a 12-sided cylinder round and a box's edges sharp."""

MOST_NEIGHBOURS = 64
"""A vertex where more faces meet is the hub of a fan (a cap, a cone's tip): its faces keep their own normals."""

PAIRS_AT_ONCE = 1_000_000
"""Pairs of neighbouring corners handled at a time, which bounds the memory taken to some 100 MB."""


def corner_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32], crease: float = CREASE) -> NDArray[np.float64]:
    """(F, 3, 3) unit normals to shade every corner of every face with, on the side to which that face is wound.

    A corner's normal is the mean, weighted by the angle at the vertex, of the normals of those faces around the same *place* that
    make less than `crease` (rad) with its own face. Faces wound the other way count as if turned over, so a mesh that is wound
    inconsistently shades as a consistent one does. A face without area has the normal +z and no say in its neighbours'; that of
    a sliver of aspect a is right to 8 a units in the last place.
    """
    triangles = vertices[faces]  # (F, 3, 3)
    normal = face_vectors(triangles)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 0, normal / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])
    normal_of = np.repeat(normal, 3, axis=0)  # (3F, 3), a row a corner
    weighted = normal_of * (_angles(triangles) * (length > 0)).reshape(-1, 1)

    places = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)
    place = places[faces].reshape(-1)  # (3F,)
    order = np.argsort(place, kind="stable")
    count = np.bincount(place)
    first = np.cumsum(count) - count

    smooth = normal_of.copy()
    corners = order[count[place[order]] <= MOST_NEIGHBOURS]
    for some in _batches(corners, count[place[corners]]):
        each = count[place[some]]
        starts = np.cumsum(each) - each
        rank = np.arange(each.sum()) - np.repeat(starts, each)
        mine, other = np.repeat(some, each), order[np.repeat(first[place[some]], each) + rank]  # (P,) pairs
        cosine = np.einsum("ij,ij->i", normal_of[mine], normal_of[other])
        share = np.where(np.abs(cosine) > np.cos(crease), np.sign(cosine), 0.0)
        smooth[some] = np.add.reduceat(weighted[other] * share[:, None], starts)
    length = np.linalg.norm(smooth, axis=1, keepdims=True)
    smooth = np.where(length > 0, smooth / np.where(length > 0, length, 1), normal_of)
    return np.asarray(smooth.reshape(-1, 3, 3))


def _angles(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 3) the angle at every corner, rad."""
    ahead = np.roll(triangles, -1, axis=1) - triangles
    behind = np.roll(triangles, 1, axis=1) - triangles
    cross = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.asarray(np.arctan2(cross, np.einsum("fci,fci->fc", ahead, behind)))


def _batches(corners: NDArray[np.intp], pairs: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """`corners` cut into runs of about `PAIRS_AT_ONCE` pairs each."""
    cuts = np.flatnonzero(np.diff(np.cumsum(pairs) // PAIRS_AT_ONCE)) + 1
    return [run for run in np.split(corners, cuts) if len(run)]

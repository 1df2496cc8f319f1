"""A closed mesh pulled through places where the true surface is known: those that were touched."""

from __future__ import annotations

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.surface_wrapping import Faces, Points, mesh_edges, neighbour_means, split_edges

ROUNDS = 4
"""Of finding the part of the mesh that belongs to each point, and pulling it there."""
FINE = 4
"""Edges around the points become about this many times shorter."""
TURNED = 2.0
"""Spacings that a face counts farther from a point whose normal is perpendicular to its own; opposite ones count twice that."""
CANDIDATES = 6
"""Faces, nearest by their middles, among which the nearest one is looked for."""
REACH = 4.0
"""Spacings around the points within which the mesh gives way."""
FALLOFF = 3.0
"""What is pulled far takes more along: this multiple of the distance …"""
LARGEST_SHARE = 0.25
"""… but no more than this share of the mesh's extent."""
STIFFNESS = 0.3
"""Weight of bending beside that of the points."""


def attach_points(
    vertices: Points, faces: Faces, points: Points, normals: Points, *, spacing: float, tolerance: float
) -> tuple[Points, Faces]:
    """Pull a closed mesh through points, and what is around them along, smoothly.

    Parameters
    ----------
    vertices, faces
        The mesh, normals outwards.
    points, normals
        (N, 3) each: places on the true surface, and about its outward unit normals there; 0 where unknown.
    spacing
        Length of the mesh's edges.
    tolerance
        From each point to the mesh it is at most as far.

    Returns
    -------
    Vertices and faces of a closed mesh, finer around the points.

    Raises
    ------
    InvalidInput
        A point or a normal is NaN or infinite.

    Notes
    -----
    A point belongs to the nearest part of the mesh that faces the same way, so that the two sides of a thin body are not confused. First
    the displacement is the one that bends least (squared graph Laplacian), which takes details along; then, close to the points, the
    mesh itself bends least and passes near them. What is farther than the tolerance after some rounds becomes a vertex of the mesh.
    """
    if not (np.isfinite(points).all() and np.isfinite(normals).all()):
        raise InvalidInput("touched points or their normals are NaN or infinite: no surface goes through them")
    if not len(points):
        return vertices, faces
    for number in range(ROUNDS):
        for _ in range(2):  # each at most halves the edges
            place = _belonging(vertices, faces, points, normals, spacing)[1]
            ends, _edge = mesh_edges(faces)
            long = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) > 1.5 * spacing / FINE
            near = cKDTree(place).query(vertices[ends].mean(axis=1))[0] < spacing
            vertices, faces = split_edges(vertices, faces, long & near)
        vertices = _pulled(vertices, faces, points, *_belonging(vertices, faces, points, normals, spacing), spacing, coarse=not number)
    return _inserted(vertices, faces, points, tolerance)


def _belonging(vertices: Points, faces: Faces, points: Points, normals: Points, spacing: float) -> tuple[NDArray[np.intp], Points]:
    """Find the face that each point belongs to, and the nearest place on it."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    facing = np.divide(across, length, out=np.zeros_like(across), where=length > 0)
    turned = TURNED * spacing / np.sqrt(2)
    tree = cKDTree(np.concatenate([corners.mean(axis=1), turned * facing], axis=1))
    count = min(CANDIDATES, len(faces))
    found = tree.query(np.concatenate([points, turned * normals], axis=1), k=count)[1].reshape(-1)  # (N count)
    asked = np.repeat(points, count, axis=0)
    places: Points = trimesh.triangles.closest_point(corners[found], asked)  # type: ignore[no-untyped-call]
    best = np.linalg.norm(places - asked, axis=1).reshape(-1, count).argmin(axis=1) + count * np.arange(len(points))
    return found[best], places[best]


def _pulled(
    vertices: Points, faces: Faces, points: Points, face: NDArray[np.intp], places: Points, spacing: float, *, coarse: bool
) -> Points:
    """Displace the vertices around the places so that these come to the points, or near; where `coarse`, details come along as they are."""
    offset = points - places
    apart, nearest = cKDTree(places).query(vertices)
    farthest = LARGEST_SHARE * float(np.ptp(vertices, axis=0).max())
    free = apart < REACH * spacing + np.minimum(FALLOFF * np.linalg.norm(offset, axis=1)[nearest], farthest)
    corners = vertices[faces[face]]
    weights = 1 / np.maximum(np.linalg.norm(corners - places[:, None], axis=2), 1e-3 * spacing)  # enough, for what is left is pulled again
    weights /= weights.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(points)), 3)
    held = sparse.csr_array((weights.ravel(), (rows, faces[face].ravel())), shape=(len(points), len(vertices)))[:, free]
    laplacian = neighbour_means(faces, len(vertices)) - sparse.eye_array(len(vertices), format="csr")
    bent = laplacian[:, free]
    system = held.T @ held + STIFFNESS * bent.T @ bent + 1e-9 * sparse.eye_array(bent.shape[1])  # where nothing holds a part
    moved = vertices.copy()
    shape = 0 if coarse else STIFFNESS * bent.T @ (laplacian @ vertices)
    moved[free] += splu(system.tocsc()).solve(held.T @ offset - shape)
    return moved


def _inserted(vertices: Points, faces: Faces, points: Points, tolerance: float) -> tuple[Points, Faces]:
    """Make vertices of the points that are farther from the mesh than the tolerance; each splits its nearest face into three."""
    while True:
        squared, face, _ = igl.point_mesh_squared_distance(points, vertices, faces)
        order = np.argsort(-squared, kind="stable")
        order = order[squared[order] > tolerance**2]
        if not len(order):
            return vertices, faces
        split, first = np.unique(face[order], return_index=True)  # one point per face and round: a vertex once made stays
        a, b, c = faces[split].T
        new = len(vertices) + np.arange(len(split))
        parts = [np.stack(corners, axis=1) for corners in ((a, b, new), (b, c, new), (c, a, new))]
        vertices = np.concatenate([vertices, points[order[first]]])
        faces = np.concatenate([np.delete(faces, split, axis=0), *parts])

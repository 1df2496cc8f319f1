"""Links cut into slabs: several convex parts describe a bent or hollow link better than one hull and one box."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Link, Shape


def split_link(link: Link, count: int) -> Link:
    """Cut the meshes among a link's collision shapes into slabs across their longest side.

    Parameters
    ----------
    link
        Its boxes, spheres and cylinders stay as they are.
    count
        Slabs per mesh.

    Returns
    -------
    The link with one convex shape per slab that holds something.
    """
    shapes: list[Shape] = []
    for shape in link.collisions:
        shapes += _slabs(shape, count) if shape.kind == "mesh" else [shape]
    return replace(link, collisions=tuple(shapes))


def _slabs(shape: Shape, count: int) -> list[Shape]:
    low, high = shape.mesh.vertices.min(axis=0), shape.mesh.vertices.max(axis=0)
    axis = int(np.argmax(high - low))
    ends = np.linspace(low[axis], high[axis], count + 1)
    across = np.eye(3)[axis]
    triangles = np.asarray(shape.mesh.vertices)[shape.mesh.faces]
    slabs = []
    for start, end in pairwise(ends):
        vertices, faces = _between(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), across, start, end)
        try:
            hull = ConvexHull(vertices) if len(faces) else None
        except QhullError:  # a slab that is flat, such as where a plane face lies in the cut
            hull = None
        if hull is not None:
            slabs.append(replace(shape, mesh=Mesh.bare(vertices[hull.vertices], _corners(hull))))
    return slabs or [shape]


def _between(
    vertices: NDArray[np.float64], faces: NDArray[np.intp], across: NDArray[np.float64], start: float, end: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    cut: Any = trimesh.intersections.slice_faces_plane
    for normal, offset in ((across, start), (-across, end)):
        if len(faces):
            vertices, faces, _ = cut(vertices, faces, normal, across * offset)
    return vertices, faces


def _corners(hull: ConvexHull) -> NDArray[np.int32]:
    number = np.zeros(len(hull.points), np.int32)
    number[hull.vertices] = np.arange(len(hull.vertices))
    return np.asarray(number[hull.simplices], np.int32)

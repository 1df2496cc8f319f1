"""Convex collision shapes of links, as physics, distances and overlaps take meshes.

Time and memory grow with a hull's faces. So a heavy mesh becomes a hull with a budget of faces when the hand is loaded: corners that lie
no more than a tolerance outside the others' hull are dropped.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh, without_slivers
from pipeline.kernels.hand.model import Link, Shape

MAX_FACES = 1000  # of a collision shape; a mesh with no more is used as it is
TOLERANCE = 1e-4  # m that a heavier hull may lose, a tenth of the clearance of grasps; doubled until the rest fits
SHRUNKEN_TOLERANCE = 3e-4  # m that a hull for physics may lose: each corner costs time wherever the link meets the object
THINNEST_SHARE = 0.9  # share of the depth of a hull's middle by which its faces may move inwards
SAMPLE_SPACING = 2e-3  # m, between points on convex shapes at which their distance from the mesh is measured
ON_SURFACE = 1e-6  # m, within which a point counts as on a convex shape's surface


@dataclass(frozen=True)
class ConvexError:
    """The differences between a link's meshes and its convex shapes."""

    faces: int  # of the meshes
    kept: int  # faces of the convex shapes in their place
    lost: float  # m, distance of the meshes' farthest point outside the shapes
    filled: float  # m, depth of the deepest hollow of the meshes that the shapes fill, right to `SAMPLE_SPACING`


def with_convex_shapes(link: Link, slabs: int | None = None) -> Link:
    """Replace the heavy meshes among a link's collision shapes by convex hulls, or all of them by hulls of slabs.

    With `slabs`, each mesh is cut into as many slabs across its longest side; without, a mesh of more than `MAX_FACES` faces becomes one
    hull. Flat meshes and other shapes, such as boxes, stay as they are.
    """
    shapes: list[Shape] = []
    for shape in link.collisions:
        if shape.kind != "mesh" or (slabs is None and len(shape.mesh.faces) <= MAX_FACES):
            shapes.append(shape)
        else:
            hulls = [_hull(points) for points in _slab_points(shape.mesh, slabs or 1)]
            shapes += [replace(shape, mesh=hull) for hull in hulls if hull is not None] or [shape]
    return replace(link, collisions=tuple(shapes))


def _slab_points(mesh: Mesh, count: int) -> list[Array]:
    """List the points (N, 3) that span each slab: the vertices in it, and where faces cross its ends."""
    from trimesh.intersections import slice_faces_plane  # takes half a second

    vertices = mesh.vertices[np.unique(mesh.faces)]
    if count == 1:
        return [vertices]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    along, slice_faces = np.eye(3)[np.argmax(high - low)], cast(Any, slice_faces_plane)
    slabs = []
    for start, end in pairwise(low + np.linspace(0, 1, count + 1)[:, None] * (high - low)):
        above = slice_faces(mesh.vertices, mesh.faces, along, start)[:2]
        slabs.append(slice_faces(*above, -along, end)[0])
    return slabs


def _hull(points: Array) -> Mesh | None:
    """Compute a convex hull of at most `MAX_FACES` faces; None where the points are flat."""
    try:
        hull = _exact_hull(points)
    except (scipy.spatial.QhullError, ValueError):  # such as where a plane face lies in the cut
        return None
    corners, tolerance = hull.vertices, TOLERANCE
    while len(hull.faces) > MAX_FACES:
        hull = _hull_within(corners, tolerance)
        tolerance *= 2
    return hull


def _hull_within(corners: Array, tolerance: float) -> Mesh:
    """Compute the hull of some corners (N, 3) of a convex body, outside of which no other corner is farther than `tolerance`."""
    kept = np.zeros(len(corners), bool)
    hull = scipy.spatial.ConvexHull(corners, qhull_options=f"Qt W{tolerance:.17g}")  # W: what is nearer to a facet's plane is dropped
    kept[hull.vertices] = True
    while True:
        hull = _exact_hull(corners[kept])
        distances, facets, _ = nearest_faces(corners, hull)
        missed = np.flatnonzero(distances > tolerance)  # beside a sharp edge, which is farther away than the planes that meet there
        if not len(missed):
            return hull
        farthest = missed[np.argsort(-distances[missed], kind="stable")]
        kept[farthest[np.unique(facets[farthest], return_index=True)[1]]] = True  # one for each facet


def shrunken_hull(mesh: Mesh, by: float) -> Mesh:
    """Compute the convex hull of a mesh with its faces moved inwards, m, by less where it is too thin; it has few corners."""
    hull = scipy.spatial.ConvexHull(mesh.vertices)
    planes = np.unique(np.round(hull.equations, 9), axis=0)
    middle = hull.points[hull.vertices].mean(axis=0)
    depth = -float((planes[:, :3] @ middle + planes[:, 3]).max())
    by = min(by, THINNEST_SHARE * depth)
    planes[:, 3] += by
    return _hull_within(scipy.spatial.HalfspaceIntersection(planes, middle).intersections, min(SHRUNKEN_TOLERANCE, (depth - by) / 2))


def _exact_hull(points: Array) -> Mesh:
    hull = scipy.spatial.ConvexHull(points)
    return Mesh.bare(points[hull.vertices], np.searchsorted(hull.vertices, hull.simplices))


def nearest_faces(points: Array, mesh: Mesh) -> tuple[Array, NDArray[np.int64], Array]:
    """Compute the distances (N,) of points (N, 3) from a mesh, m, the nearest faces (N,), and the points (N, 3) there."""
    import igl  # 27 MB, for hands with convex parts only

    faces = without_slivers(mesh.vertices, mesh.faces.astype(np.int64))
    squared, face, closest = igl.point_mesh_squared_distance(points, mesh.vertices, faces)
    return np.sqrt(squared), face, closest


def convex_error(link: Link, convex: Link) -> ConvexError:
    """Measure the differences between a link's meshes as read, one at least, and the shapes of `with_convex_shapes`."""
    from trimesh.remesh import subdivide_to_size  # takes half a second

    from pipeline.kernels.geometry.signed_distance import signed_distances  # imports trimesh, too

    meshes, hulls = ([shape.mesh for shape in shapes if shape.kind == "mesh"] for shapes in (link.collisions, convex.collisions))
    corners = np.concatenate([mesh.vertices[np.unique(mesh.faces)] for mesh in meshes])
    lost = np.min([signed_distances(corners, hull.vertices, hull.faces) for hull in hulls], axis=0).max()
    filled = 0.0
    for number, hull in enumerate(hulls):
        subdivide: Any = subdivide_to_size
        points = subdivide(hull.vertices, hull.faces, max_edge=SAMPLE_SPACING)[0]
        points = points[np.unique(np.round(points / SAMPLE_SPACING), axis=0, return_index=True)[1]]  # one for each small cube
        for other_hull in (*hulls[:number], *hulls[number + 1 :]):  # where slabs meet, the mesh may be solid
            points = points[signed_distances(points, other_hull.vertices, other_hull.faces) > ON_SURFACE]
        if len(points):
            filled = max(filled, float(np.min([nearest_faces(points, mesh)[0] for mesh in meshes], axis=0).max()))
    return ConvexError(sum(len(mesh.faces) for mesh in meshes), sum(len(hull.faces) for hull in hulls), max(float(lost), 0.0), filled)

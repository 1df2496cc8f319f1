"""Quality of a reconstructed surface beyond distances: area, creases, gaps, normals, self-intersections, overlap of volumes.

Vertices are (V, 3) float64, finite, m; faces (F, 3) integers, F at least 1.
"""

import numpy as np
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Integers, Mask
from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.mesh import check_coordinates, face_cross_products
from pipeline.kernels.geometry.mesh_cleaning import group_by_position
from pipeline.kernels.geometry.signed_distance import inside_test
from pipeline.kernels.metrics.cloud_distances import CloudDistances


def surface_area(vertices: Array, faces: Integers) -> float:
    """Compute the area of a surface, m²; overlapping parts all count."""
    check_coordinates(vertices, "vertices")
    return float(np.linalg.norm(face_cross_products(vertices[faces]), axis=1).sum() / 2)


def dihedral_angles(vertices: Array, faces: Integers) -> Array:  # (E,) degrees, of edges of two faces with an area
    """Compute the angles between the normals of faces that share an edge: 0 on a plane, 180 where a surface folds back onto itself."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    sound = (mesh.area_faces > 0)[mesh.face_adjacency].all(axis=1)
    first, second = np.moveaxis(mesh.face_normals[mesh.face_adjacency[sound]], 1, 0)
    return np.asarray(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), (first * second).sum(axis=1))))


def seam_gaps(vertices: Array, position: Integers) -> Array:  # (S,) m
    """Compute the largest distance between vertices (V, 3) of each position (V,), one point of the surface before it was deformed."""
    shared = [vertices[group] for group in group_by_position(position) if len(group) > 1]
    return np.array([np.linalg.norm(group[:, None] - group, axis=2).max() for group in shared])


def normal_consistency(normals: Array, true_normals: Array, distances: CloudDistances) -> float:
    """Compute how well the unit normals (N, 3) at the points of two clouds agree: 1 where they are parallel everywhere, 0.5 by chance.

    It is the mean absolute cosine between the normal at each point and that at the other cloud's nearest, both ways.
    """
    pairs = ((normals, true_normals[distances.nearest_true]), (true_normals, normals[distances.nearest_predicted]))
    return sum(float(np.abs((ours * nearest).sum(axis=1)).mean()) for ours, nearest in pairs) / 2


def crossing_faces(
    vertices: Array,
    faces: Integers,
    position: Integers | None = None,  # (V,) vertices with the same number were one point; None: all differ
) -> Mask:  # (F,)
    """Find the faces that cross another one, in other than one plane; neighbours, which share a vertex or position, are skipped."""
    corners = np.asarray(vertices[faces], float)  # (F, 3, 3)
    axis = int(np.argmax(np.ptp(corners.reshape(-1, 3), axis=0)))
    order = np.argsort(corners[:, :, axis].min(axis=1))
    corners, ids = corners[order], (faces if position is None else position[faces])[order]
    crossing = np.zeros(len(faces), bool)
    _mark_crossing(corners, corners.min(axis=1), corners.max(axis=1), ids, axis, crossing)
    return crossing[np.argsort(order)]


@compiled
def _mark_crossing(corners: Array, low: Array, high: Array, ids: Integers, axis: int, crossing: Mask) -> None:
    """Mark the triangles (F, 3, 3), sorted by `low` along an axis, that cross another one and share no vertex number with it."""
    for first in range(len(corners)):
        for second in range(first + 1, len(corners)):
            if low[second, axis] > high[first, axis]:
                break
            disjoint = False
            for i in range(3):
                disjoint |= (low[second, i] > high[first, i]) | (low[first, i] > high[second, i])
            if disjoint or (crossing[first] and crossing[second]):
                continue
            neighbours = False
            for i in range(3):
                for j in range(3):
                    neighbours |= ids[first, i] == ids[second, j]
            if not neighbours and (_pierces(corners[first], corners[second]) or _pierces(corners[second], corners[first])):
                crossing[first] = crossing[second] = True


@compiled
def _pierces(triangle: Array, other: Array) -> bool:
    """Find whether a side of a triangle, (3, 3), goes through the inside of another one; one in its plane does not."""
    for number in range(3):
        start, end = triangle[number], triangle[(number + 1) % 3]
        before, after = _volume(other[0], other[1], other[2], start), _volume(other[0], other[1], other[2], end)
        if not (before < 0 < after or after < 0 < before):
            continue
        u, v, w = _volume(start, end, other[0], other[1]), _volume(start, end, other[1], other[2]), _volume(start, end, other[2], other[0])
        if min(u, v, w) > 0 or max(u, v, w) < 0:  # it passes all three sides of the other on the same side
            return True
    return False


@compiled
def _volume(a: Array, b: Array, c: Array, d: Array) -> float:
    """Compute six times the volume of a tetrahedron; its sign gives the side of the plane abc on which the corner d is."""
    p, q, r = a[0] - d[0], a[1] - d[1], a[2] - d[2]
    s, t, u = b[0] - d[0], b[1] - d[1], b[2] - d[2]
    x, y, z = c[0] - d[0], c[1] - d[1], c[2] - d[2]
    volume: float = p * (t * z - u * y) + q * (u * x - s * z) + r * (s * y - t * x)
    return volume


def intersection_over_union(first: tuple[Array, Integers], second: tuple[Array, Integers], points: Array) -> float:
    """Compute the intersection over union of two closed surfaces by points (N, 3) spread evenly over a box around both."""
    inside = [inside_test(*surface)(points) for surface in (first, second)]
    if not (either := (inside[0] | inside[1]).sum()):
        raise InvalidInput(f"none of {len(points)} points is inside either surface: take more of them, or surfaces that are closed")
    return float((inside[0] & inside[1]).sum() / either)

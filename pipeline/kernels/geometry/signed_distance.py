"""Distances from points to a mesh, and points drawn around it."""

from collections.abc import Callable

import igl
import numpy as np
from numpy.typing import NDArray
from trimesh import graph

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Integers, Mask
from pipeline.kernels.geometry.mesh import check_coordinates, directed_edges, face_cross_products, without_slivers
from pipeline.kernels.geometry.mesh_cleaning import number_positions

INSIDE_WINDING = 0.5  # size of the winding number above which a point is inside: 1 or -1 in a closed mesh
BALANCED = 1e-9  # share of the parts' volume below which their sum is rounding, and the largest part decides


def signed_distances(points: Array, vertices: Array, faces: Integers) -> Array:  # (N,) m
    """Compute signed distances of points (N, 3) to a mesh: positive outside, negative inside, as `inside_test` has it.

    They err by at most 1e-13 of the largest coordinate, beside slivers by 4e-6 of their length. Inside, where parts of the mesh overlap, a
    distance is that to the nearest face of any part: no more than that to the surface of the whole. A mesh need not be closed: both sides
    of an open sheet are outside.
    """
    inside = inside_test(vertices, faces)(points)
    distances = np.sqrt(_squared_distances(points, vertices, faces))
    return np.asarray(np.where(inside, -distances, distances))


def inside_test(vertices: Array, faces: Integers) -> Callable[[Array], Mask]:  # (N, 3) -> (N,)
    """Prepare a test which points are inside a surface, by the generalised winding number (Jacobson et al., 2013; Barill et al., 2018).

    Neighbouring faces may be wound against each other: the smaller area of a part is turned over. Parts that are turned inside out count
    as inside too, unless they lie within another: then they are its cavities.
    """
    if not len(faces):
        raise InvalidInput("a mesh without faces has neither surface nor inside")
    check_coordinates(vertices, "vertices")
    surface = igl.FastWindingNumberBVH()
    surface.init(np.ascontiguousarray(vertices), _consistently_wound(vertices, np.ascontiguousarray(faces, np.int64)))

    def inside(points: Array) -> Mask:
        check_coordinates(points, "points")
        return np.asarray(np.abs(surface.winding_number(np.ascontiguousarray(points))) > INSIDE_WINDING)

    return inside


def _consistently_wound(vertices: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Turn faces over so that those on both sides of an edge agree; a part keeps the side that most of its area has."""
    positions = number_positions(vertices)[faces]
    if not graph.is_watertight(directed_edges(positions))[1]:
        agreeing, part = igl.bfs_orient(positions)
        turned = (agreeing != positions).any(axis=1)
        areas = np.linalg.norm(face_cross_products(vertices[faces]), axis=1)
        turned ^= (np.bincount(part, np.where(turned, areas, -areas)) > 0)[part]
        faces, positions = (np.where(turned[:, None], one[:, ::-1], one) for one in (faces, positions))
    return _turn_inverted_parts(vertices, faces, positions)


def _turn_inverted_parts(vertices: Array, faces: NDArray[np.int64], positions: NDArray[np.int64]) -> NDArray[np.int64]:
    """Turn over closed parts wound against most of the volume, whose winding numbers would cancel, unless they are cavities."""
    count, part = igl.facet_components(positions)
    if count == 1:
        return faces
    volumes = np.bincount(part, np.linalg.det(vertices[faces] - vertices.mean(axis=0)), count)  # six times those of closed parts
    total, largest = volumes.sum(), volumes[np.abs(volumes).argmax()]
    most = total if abs(total) > BALANCED * np.abs(volumes).sum() else largest  # a mirrored half has exactly the opposite volume
    edges, faces_of_edge = np.unique(np.sort(directed_edges(positions), axis=1), axis=0, return_inverse=True, return_counts=True)[1:]
    is_closed = np.bincount(np.repeat(part, 3), faces_of_edge[edges.reshape(-1)] % 2) == 0  # (P,) an even number of faces at each edge
    turned = ((volumes * most < 0) & is_closed)[part]
    if not turned.any():
        return faces
    corners, within = np.unique(faces[turned]), np.zeros(len(vertices), bool)
    winding = igl.fast_winding_number(np.ascontiguousarray(vertices), np.ascontiguousarray(faces[~turned]), vertices[corners])
    within[corners] = np.abs(winding) > INSIDE_WINDING
    cavity = np.bincount(part, ~within[faces].all(axis=1), count) == 0
    return np.where((turned & ~cavity[part])[:, None], faces[:, ::-1], faces)


def rms_distance_to_surface(points: Array, vertices: Array, faces: Integers) -> float:  # as accurate as `signed_distances`
    """Compute the root of the mean squared distance from points (N, 3) to the nearest of faces, which may be slivers or points."""
    if not len(points) or not len(faces):
        raise InvalidInput(f"{len(points)} points and {len(faces)} faces: a distance needs at least one of each")
    check_coordinates(points, "points")
    check_coordinates(vertices, "vertices")
    return float(np.sqrt(np.mean(_squared_distances(points, vertices, faces))))


def _squared_distances(points: Array, vertices: Array, faces: Integers) -> Array:  # (N,)
    """Compute squared distances to the nearest face; slivers count as their longest edges."""
    vertices = np.ascontiguousarray(vertices)
    triangles = without_slivers(vertices, np.ascontiguousarray(faces, np.int64))
    return np.asarray(igl.point_mesh_squared_distance(np.ascontiguousarray(points), vertices, triangles)[0])


def sample_around_surface(
    surface: Array,  # (P, 3) m
    count: int,
    rng: np.random.Generator,
    *,
    near: float,  # share of the points near the surface: its points, moved along each axis by normal deviates
    spread: tuple[float, float],  # least and largest standard deviation, m; each point's is uniform in its logarithm
    reach: float,  # half the side of the cube around the middle of the surface's bounding box, m
) -> Array:  # (count, 3) m
    """Draw points in space, in random order: a share near a surface, the others throughout the cube around it."""
    near_count = round(near * count)
    low, high = np.log(spread).tolist()
    deviation = np.exp(rng.uniform(low, high, (near_count, 1)))
    near_points = surface[rng.integers(len(surface), size=near_count)] + deviation * rng.normal(size=(near_count, 3))
    middle = (surface.min(axis=0) + surface.max(axis=0)) / 2
    spread_points = middle + rng.uniform(-reach, reach, (count - near_count, 3))
    return rng.permutation(np.concatenate([near_points, spread_points]))

"""Sampling of the exterior surface of a mesh, with outward normals.

CAD models contain interior geometry that no hand or camera meets. A surface point is *exterior* when rays in at least two of 256
directions spread over the sphere escape from it without hitting the object. One is not enough: rounding lets a few per cent of the
interior points escape. More directions keep finding the walls of ever narrower gaps, hence their number is part of the definition.

Valid range: meshes from 1e-9 to 1e9 units large; open, inside-out and self-intersecting meshes. A wall or gap thinner than 2e-5 of
the object's diagonal may count as a single sheet: rays start off the surface, and Embree computes in float32.
"""

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Indices, Integers, Mask
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products, sample_triangles
from pipeline.kernels.geometry.transforms import length, sin_cos, unit_vectors

DIRECTIONS = 256
MIN_ESCAPES = 2  # escaping rays that make a point exterior
CERTAIN_ESCAPES = 2 * MIN_ESCAPES  # on one side, and none on the other, that decide which is outside without a full count
RAY_OFFSET = 4e-6  # of a ray's start from the surface over the diagonal: beyond float32 rounding, below any real gap
MAX_DRAWS = 200  # sampling fails when fewer than one of `MAX_DRAWS` points is exterior


class RayScene:
    """A mesh through which Embree traces rays in float32: at unit size, at the origin."""

    def __init__(self, vertices: Array, faces: Integers) -> None:
        corners = vertices[np.unique(faces)]
        low, high = corners.min(axis=0), corners.max(axis=0)
        self._centre, self._scale = (low + high) / 2, 1 / float(length(high - low))
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, self._local(vertices).astype(np.float32), faces.astype(np.int32))

    def _local(self, points: Array) -> Array:
        return np.asarray((points - self._centre) * self._scale)

    def escape(self, points: Array, directions: Array, offset: float) -> Mask:  # (...)
        """Find the rays that hit nothing, of points and unit directions (..., 3); they start an offset, in diagonals, away."""
        origins = (self._local(points) + offset * directions).astype(np.float32)
        rays = np.broadcast_to(directions.astype(np.float32), origins.shape)
        occlusion = self._scene.run(origins.reshape(-1, 3), rays.reshape(-1, 3), query="OCCLUDED")  # 0 where something is hit
        return np.asarray(occlusion, bool).reshape(origins.shape[:-1])

    def count_escapes(self, points: Array, normals: Array, directions: Array) -> tuple[Indices, Indices]:  # (N,) each
        """Count the rays that escape in front of and behind the surface, at points (N, 3) on it with unit normals (N, 3).

        Counts stop at `CERTAIN_ESCAPES` on one side and none on the other; whether a point is exterior and where outside is are the full
        count's answers.
        """
        front, back = np.zeros(len(points), np.intp), np.zeros(len(points), np.intp)
        undecided = np.arange(len(points))
        first, size = 0, 8
        while first < len(directions) and len(undecided):
            batch = directions[first : first + size]
            free = self.escape(points[undecided, None], batch, RAY_OFFSET)
            ahead = np.einsum("nc,cd->nd", normals[undecided], np.ascontiguousarray(batch.T)) > 0
            front[undecided] += (free & ahead).sum(axis=1)
            back[undecided] += (free & ~ahead).sum(axis=1)
            certain = (np.maximum(front, back) >= CERTAIN_ESCAPES) & (np.minimum(front, back) == 0)
            undecided = undecided[~certain[undecided]]
            first, size = first + size, max(size, first + size)  # 8, 8, 16, 32, …
        return front, back


def spread_directions(count: int) -> Array:
    """Spread unit vectors (count, 3) evenly over the sphere: a Fibonacci lattice, in an order whose first few are spread widely too."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = index * np.pi * (3 - np.sqrt(5))
    sin, cos = sin_cos(angle)
    lattice = np.stack([np.sqrt(1 - z * z) * cos, np.sqrt(1 - z * z) * sin, z], axis=1)
    golden = (np.arange(count) * ((np.sqrt(5) - 1) / 2)) % 1  # a low-discrepancy order
    return np.ascontiguousarray(lattice[np.argsort(np.argsort(golden, kind="stable"), kind="stable")])


def sample_exterior(
    mesh: Mesh,  # of any winding; it decides where as many rays escape on both sides
    count: int,
    rng: np.random.Generator,
    *,
    directions: int = DIRECTIONS,  # in which rays are traced
) -> tuple[Array, Array]:  # (count, 3) each, unit and frame of the mesh
    """Draw points area-uniformly from the exterior surface of a mesh, with normals to the side where more rays escape."""
    if count < 1:
        raise ValueError(f"{count} points were requested; ask for 1 or more")
    triangles = mesh.triangles
    sample_triangles(triangles, 0, rng)  # refuses a mesh without a surface before its size divides anything
    vectors = face_cross_products(triangles)
    scene, rays = RayScene(mesh.vertices, mesh.faces), spread_directions(directions)
    points, normals = np.zeros((0, 3)), np.zeros((0, 3))
    drawn = 0
    while len(points) < count:
        if drawn >= MAX_DRAWS * count:
            fault = f"{len(points)} of {drawn} points on the surface are exterior"
            raise InvalidInput(f"{fault}, too few to draw {count}; does the mesh enclose its surface?")
        share = len(points) / drawn if len(points) else 1.0
        size = int(min(max((count - len(points)) / share * 1.05, 256), 4 * count))
        candidates, face = sample_triangles(triangles, size, rng)
        unit = unit_vectors(vectors[face])
        front, back = scene.count_escapes(candidates, unit, rays)
        exterior = front + back >= MIN_ESCAPES
        outward = np.where(back > front, -1.0, 1.0)[:, None] * unit
        points, normals = np.concatenate([points, candidates[exterior]]), np.concatenate([normals, outward[exterior]])
        drawn += size
    return points[:count], normals[:count]

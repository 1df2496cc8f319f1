"""Which points of a surface can be seen from outside, and on which side outside is.

CAD models carry geometry inside; a hand or a camera meets none of it. A surface point is *exterior* when at least
two of 256 directions spread over its sphere leave the object unhindered. One is not enough: rounding lets a few per
cent of interior points out. More directions keep finding the walls of ever narrower gaps, so their number is part of
the definition.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh, face_cross_products
from pipeline.kernels.geometry.transforms import length, sin_cos
from pipeline.kernels.geometry.triangle_sampling import sample_triangles

DIRECTIONS = 256
ESCAPES = 2
SURE_OF_SIDE = 2 * ESCAPES
"""Escapes on one side, and none on the other, that settle which side is outside; else all directions are counted."""

START = 4e-6
"""Rays start this share of the object's diagonal off the surface: beyond float32 rounding, below any real gap."""

MAX_DRAWS = 200
"""Give up when fewer than one point in so many is exterior."""


@dataclass(frozen=True, eq=False)
class Draw:
    """Points (N, 3) drawn from a whole surface, their outward unit normals (N, 3), which of them are exterior (N,), and in how many
    directions (N,) each was looked."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    exterior: NDArray[np.bool_]
    asked: NDArray[np.intp]


class EscapeTest:
    """Tells which points of a mesh's surface see the outside, with rays traced by Embree."""

    def __init__(self, mesh: Mesh, directions: int = DIRECTIONS) -> None:
        corners = mesh.vertices[np.unique(mesh.faces)]
        low, high = corners.min(axis=0), corners.max(axis=0)
        self._centre = (low + high) / 2
        self._scale = 1 / float(length(high - low))  # Embree computes in float32: unit size, at the origin
        self._scene = rtcore_scene.EmbreeScene()
        local = ((mesh.vertices - self._centre) * self._scale).astype(np.float32)
        self._mesh = TriangleMesh(self._scene, local, mesh.faces)
        self._directions = spread_directions(directions)

    def escapes(
        self, points: NDArray[np.float64], normals: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Count directions that leave unhindered from points (N, 3), in front of and behind their normals (N, 3).

        Returns both counts, and in how many directions it was looked, each (N,). Counting stops for a point as soon as it is exterior
        and its side sure (`SURE_OF_SIDE`): whether there are `ESCAPES` is what the full count says, how many there are beyond that is
        not.
        """
        front, back, asked = (np.zeros(len(points), np.intp) for _ in range(3))
        open_points = np.arange(len(points))
        first, size = 0, 8
        while first < len(self._directions) and len(open_points):
            directions = self._directions[first : first + size]
            ahead, behind = self._round(points[open_points], normals[open_points], directions)
            front[open_points] += ahead
            back[open_points] += behind
            asked[open_points] += len(directions)
            known = (np.maximum(front, back) >= SURE_OF_SIDE) & (np.minimum(front, back) == 0)
            open_points = open_points[~known[open_points]]
            first, size = first + size, max(size, first + size)  # 8, 8, 16, 32, …
        return front, back, asked

    def _round(
        self, points: NDArray[np.float64], normals: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        local = (points - self._centre) * self._scale
        origins = (local[:, None] + START * directions).astype(np.float32).reshape(-1, 3)
        rays = np.tile(directions.astype(np.float32), (len(points), 1))
        hit = np.asarray(self._scene.run(origins, rays, query="OCCLUDED")).reshape(len(points), -1)
        free = hit != 0
        ahead = np.einsum("nc,cd->nd", normals, np.ascontiguousarray(directions.T)) > 0
        return (free & ahead).sum(axis=1), (free & ~ahead).sum(axis=1)


def spread_directions(count: int) -> NDArray[np.float64]:
    """(count, 3) unit vectors spread evenly over the sphere (Fibonacci lattice), any first few spread widely too."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = index * np.pi * (3 - np.sqrt(5))
    sin, cos = sin_cos(angle)
    lattice = np.stack([np.sqrt(1 - z * z) * cos, np.sqrt(1 - z * z) * sin, z], axis=1)
    golden = (np.arange(count) * ((np.sqrt(5) - 1) / 2)) % 1  # a low-discrepancy order
    return np.ascontiguousarray(lattice[np.argsort(np.argsort(golden, kind="stable"), kind="stable")])


def sample_exterior(
    mesh: Mesh, count: int, rng: np.random.Generator, directions: int = DIRECTIONS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw `count` points area-uniformly from the exterior surface, with outward unit normals.

    Returns points (count, 3) and normals (count, 3), float64, in the mesh's unit and frame. Open, inside-out and
    self-intersecting meshes are welcome: outside is where the escaping directions point, not what the winding says.
    Where a sheet is seen from both sides alike, the winding decides. A wall with a thickness or gap of less than 2e-5 of the
    object's diagonal may count as a sheet: rays start off the surface, and Embree computes in float32.

    Raises
    ------
    ValueError
        Fewer than one point in `MAX_DRAWS` is exterior, a corner is NaN or infinite, no face has an area, or `count` is below 1.
    """
    batches = [(draw.points[draw.exterior], draw.normals[draw.exterior]) for draw in draws(mesh, count, rng, directions)]
    points, normals = (np.concatenate(part)[:count] for part in zip(*batches, strict=True))
    return points, normals


def draws(mesh: Mesh, count: int, rng: np.random.Generator, directions: int = DIRECTIONS) -> Iterator[Draw]:
    """Draw from the whole surface, batch by batch, until `count` points are exterior; see `sample_exterior`."""
    if count < 1:
        raise ValueError(f"{count} points are no sample; ask for 1 or more")
    triangles = mesh.triangles
    sample_triangles(triangles, 0, rng)  # refuses what has no surface, before its size divides anything
    vectors = face_cross_products(triangles)
    sky = EscapeTest(mesh, directions)
    drawn = found = 0
    while found < count:
        if drawn >= MAX_DRAWS * count:
            raise ValueError(f"{found} of {drawn} points on the surface are exterior, too few to draw {count}; is it all inside out?")
        share = found / drawn if found else 1.0
        batch = int(min(max((count - found) / share * 1.05, 256), 4 * count))
        places, face = sample_triangles(triangles, batch, rng)
        unit = vectors[face] / np.linalg.norm(vectors[face], axis=1, keepdims=True)  # a face that is drawn has an area
        front, back, asked = sky.escapes(places, unit)
        exterior = front + back >= ESCAPES
        yield Draw(places, np.where(back > front, -1.0, 1.0)[:, None] * unit, exterior, asked)
        drawn, found = drawn + batch, found + int(exterior.sum())

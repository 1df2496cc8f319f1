"""Collision shapes of a hand: spheres for distances to an object, boxes for distances between links."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Indices
from pipeline.kernels.geometry.transforms import compose, invert_pose, transform_points
from pipeline.kernels.hand.grid_loops import Spheres
from pipeline.kernels.hand.model import Hand

BLOCK = 4_000_000  # points times faces whose distances are held in memory at once: 32 MB
MAX_LATTICE = 2_000_000  # points of the lattice in a shape: at 3 mm a cube of 0.38 m, larger than any link of a hand


@dataclass(frozen=True, eq=False)
class CollisionSpheres:
    """Spheres inside the rigid links that together reach their surfaces, grouped by link, for distances to an object.

    By their centres less the radii, parts of the object inside a link are found as well as points of the link inside the object.
    """

    centres: Array  # (B, 3) in the frame of the link, m
    radii: Array  # (B,) m; 0 for points on the surface
    link: Indices  # (B,) number of the link, ascending

    def of_links(self, links: ArrayLike) -> "CollisionSpheres":
        """Select the spheres of the given links."""
        selected = np.isin(self.link, links)
        return CollisionSpheres(self.centres[selected], self.radii[selected], self.link[selected])

    @cached_property
    def single(self) -> Spheres:
        """The spheres in float32, as compiled loops take them."""
        return Spheres(self.centres.astype(np.float32), self.radii.astype(np.float32), self.link)


@dataclass(frozen=True, eq=False)
class CollisionBoxes:
    """Oriented boxes around the collision shapes."""

    frames: Array  # (C, 4, 4) in the frame of the link, m
    half: Array  # (C, 3) half extents, m
    link: Indices  # (C,) number of the link


def collision_spheres(
    hand: Hand,
    *,
    spacing: float,  # m, of the lattice of centres and of the points on the surface
    tolerance: float = 0.0,  # m, to within which a larger sphere must reach as far as one that is dropped
) -> CollisionSpheres:
    """Fill every collision shape (the convex hull of a mesh, as physics takes it) with spheres on a lattice."""
    filled_shapes = [(np.empty((0, 3)), np.empty(0), np.empty(0, np.intp))]
    for number, link in enumerate(hand.links):
        for shape in link.collisions:
            try:
                hull = scipy.spatial.ConvexHull(shape.mesh.vertices)
            except (scipy.spatial.QhullError, ValueError) as error:
                shape_name = shape.path or f"{shape.kind} of size {shape.size}"
                fault = f"collision shape {shape_name} of link {link.name} is flat or not finite"
                raise InvalidInput(f"{hand.model}: {fault}; give it a thickness, or put a box in its place") from error
            extent = np.ptp(hull.points, axis=0)
            if (extent / spacing + 1).prod() > MAX_LATTICE:
                sides = " x ".join(f"{side:.3g}" for side in extent)
                fault = f"a collision shape of link {link.name} is {sides} m large"
                remedy = 'is the scale of its mesh right? One in mm needs scale="0.001 0.001 0.001"'
                raise InvalidInput(f"{hand.model}: {fault}; {remedy}")
            points, depth = _fill(hull, spacing)
            kept = _prune(points, depth, tolerance) if tolerance > 0 else np.arange(len(points))
            filled_shapes.append((points[kept], depth[kept], np.full(len(kept), number, np.intp)))
    return CollisionSpheres(*(np.concatenate(arrays) for arrays in zip(*filled_shapes, strict=True)))


def collision_boxes(hand: Hand) -> CollisionBoxes:
    """Compute the box around every collision shape, along the axes of the shape's own frame, ordered by link."""
    frames, halves, links = [], [], []
    for number, link in enumerate(hand.links):
        for shape in link.collisions:
            local = transform_points(invert_pose(shape.origin), shape.mesh.vertices)
            low, high = local.min(axis=0), local.max(axis=0)
            shift = np.eye(4)
            shift[:3, 3] = (low + high) / 2
            frames.append(compose(shape.origin, shift))
            halves.append((high - low) / 2)
            links.append(number)
    return CollisionBoxes(np.array(frames).reshape(-1, 4, 4), np.array(halves).reshape(-1, 3), np.array(links, np.intp))


def _fill(hull: "scipy.spatial.ConvexHull", spacing: float) -> tuple[Array, Array]:
    """Make points (N, 3) in and on a convex hull, and their depth (N,) below its surface."""
    from trimesh.remesh import subdivide_to_size  # takes half a second

    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    low, high = hull.points.min(axis=0), hull.points.max(axis=0)
    counts = np.ceil((high - low) / spacing).astype(int)
    axes = [a + (np.arange(n) + 0.5) / n * (b - a) for a, b, n in zip(low, high, counts, strict=True)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    blocks = np.array_split(lattice, 1 + len(lattice) * len(offsets) // BLOCK)
    depth = np.concatenate([-(np.einsum("pc,cf->pf", block, np.ascontiguousarray(normals.T)) + offsets).max(axis=1) for block in blocks])
    subdivide: Any = subdivide_to_size
    surface, _ = subdivide(hull.points, hull.simplices, max_edge=spacing)
    surface = np.unique(np.round(surface, 9), axis=0)  # faces are split one by one: points on common edges repeat
    return np.concatenate([lattice[depth > 0], surface]), np.concatenate([depth[depth > 0], np.zeros(len(surface))])


def _prune(points: Array, depth: Array, tolerance: float) -> Indices:
    """Keep a sphere, largest first, unless a kept one contains it to within `tolerance`."""
    kept = np.empty(0, np.intp)
    for i in np.argsort(-depth, kind="stable"):
        gap = np.linalg.norm(points[kept] - points[i], axis=1) + depth[i] - depth[kept]
        if not (gap <= tolerance).any():
            kept = np.append(kept, i)
    return np.sort(kept)

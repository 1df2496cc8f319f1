"""Signed distance to a mesh, by a grid or exact, and distances of a hand from it: contact of gels, clearance of fingers, penetration."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Integers, Mask
from pipeline.kernels.geometry.face_tree import FaceTree, build_face_tree, nearest_points
from pipeline.kernels.geometry.mesh import check_coordinates, face_cross_products, without_slivers
from pipeline.kernels.geometry.transforms import transform_points, unit_vectors
from pipeline.kernels.hand.collision_shapes import CollisionSpheres
from pipeline.kernels.hand.grid_loops import Grid, gaps, look_up, near_spheres, place_probes, probe_contact
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor

BLOCK = 4  # cells along the side of a block; one exact distance tells whether a block is near the surface
MAX_CELLS = 6_000_000  # cells of the largest grid (16 bytes each); a larger object gets larger cells
LOOKUP_ERROR_CELLS = 2  # largest error of a look-up within the grid's band; as many cells beyond the band are in the grid
SIDE_PROBE_CELLS = 1.5  # cells from the surface at which a side is looked up: beyond the cells that it may cross
ON_SURFACE_CELLS = 1e-6  # cells from the surface below which rounding may decide on which side of it a point lies
MAX_STEPS = 4  # away from the nearest surface until a side is known: one beside a face, two or three in a solid's corner
PROBE_DEPTH = 0.6  # gel thicknesses above the sensor plane that a surface should reach: a firm touch, far from the plane
PROBES = 4  # probe points along a side of the gel: 4 mm apart on a 16 mm gel
IDENTITY = np.eye(4)


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Signed distance to a mesh, m: positive outside, negative inside.

    A point is outside when a path leads from it out of the bounding box through gaps wider than a cell. So winding does not matter, and
    both sides of an open sheet are outside. Solid parts thinner than 3 cells may count as sheets.
    """

    vertices: Array  # (V, 3) m
    faces: Integers  # (F, 3); slivers are edges that are run through twice
    tree: FaceTree
    origin: Array  # (3,) centre of the first cell, m
    cell: float  # m, side of a cell
    records: Array32  # (X, Y, Z, 4) signed distance of every cell's centre, m, and its gradient
    inside: NDArray[np.int8]  # (X, Y, Z) 1 if a cell's centre is inside, else 0; -1 if the surface may cross the cell

    @property
    def grid(self) -> Grid:
        """The grid as compiled loops take it."""
        return Grid(self.origin.astype(np.float32), np.float32(1 / self.cell), np.float32(self.cell), self.records)

    def lookup(self, points: Array32) -> Array32:
        """Look up the distances (...) of finite points (3, ...), world, m, to first order in the nearest cell.

        Within the band the error is about a quarter of a cell, at edges and across sheets 1.8 cells; beyond it the value is a lower bound,
        off the grid the value of its rim. In solid parts thinner than 3 cells the sign may be wrong, but no point inside gets more than 2
        cells. Rounding of coordinates to float32 adds half a micrometre per metre from the origin.
        """
        return look_up(self.grid, np.ascontiguousarray(points).reshape(3, -1)).reshape(points.shape[1:])

    def exact(self, points: Array) -> Array:
        """Compute the exact distances (N,) of finite points (N, 3), world, m.

        The error is a few units in the last place of the largest coordinate for faces of aspect up to 10, 1e-11 of a face's longest edge
        up to 1e3, and 4e-6 of it for any sliver; faces without area count as the lines and points that they are.
        """
        if not len(points):
            return np.empty(0)
        if not np.isfinite(points).all():
            raise ValueError(f"{np.count_nonzero(~np.isfinite(points))} coordinates of points are NaN or infinite; pass finite points")
        squared, _, closest = nearest_points(self.tree, points)
        distance: Array = np.sqrt(squared)
        distance[self._is_inside(closest, unit_vectors(points - closest), distance)] *= -1
        return distance

    def _is_inside(self, closest: Array, direction: Array, distance: Array) -> Mask:  # (N,)
        """Decide which points are inside, going on (N, 3) from their closest points (N, 3), until the grid knows the side."""
        inside = np.zeros(len(closest), bool)  # what stays undecided lies in a narrow gap or a thin part: outside
        undecided = np.arange(len(closest))
        for _ in range(MAX_STEPS):
            points = closest + direction * np.maximum(distance, SIDE_PROBE_CELLS * self.cell)[:, None]
            index = np.clip(np.rint((points - self.origin) / self.cell).astype(np.int64), 0, np.array(self.inside.shape) - 1)
            side = self.inside[tuple(index.T)]
            inside[undecided] = side == 1
            points, undecided = points[side < 0], undecided[side < 0]
            if not len(undecided):
                break
            squared, _, closest = nearest_points(self.tree, points)
            distance, direction = np.sqrt(squared), unit_vectors(points - closest)
        return inside


def build_distance_field(
    vertices: Array,  # (V, 3) m
    faces: np.ndarray,  # (F, 3) integers
    *,
    cell: float,  # m, side of a cell; enlarged where the grid would pass `MAX_CELLS`
    band: float,  # m from the surface, up to which the grid's values are more than bounds
) -> DistanceField:
    """Build the signed distance field of a mesh, in the frame of its vertices."""
    vertices, faces = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64)
    if not len(faces):
        raise InvalidInput("a mesh of 0 faces has no distance from anything")
    check_coordinates(vertices[faces].reshape(-1, 3), "corners of faces")
    faces = without_slivers(vertices, faces)
    tree = build_face_tree(vertices, faces)
    low, high = vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))
    cell, margin, blocks = _grid_layout(high - low, cell, band)
    low = low - margin
    block_centres = low + (np.argwhere(np.ones(blocks)) + 0.5) * cell * BLOCK
    block_distance = np.sqrt(nearest_points(tree, block_centres)[0]).reshape(blocks)
    reach = BLOCK * cell * np.sqrt(3) / 2  # from a block's centre to its corner
    distance = np.kron(np.maximum(block_distance - reach, margin), np.ones((BLOCK,) * 3))
    near_cells = (BLOCK * np.argwhere(block_distance <= margin + reach)[:, None] + np.argwhere(np.ones((BLOCK,) * 3))).reshape(-1, 3)
    centres, near = low + (near_cells + 0.5) * cell, tuple(near_cells.T)
    squared, face, closest = nearest_points(tree, centres, BLOCK**3)
    distance[near] = np.sqrt(squared)

    # Between neighbouring centres with a surface between them, one is at most half a cell from it: no path leaks through.
    is_open = distance > cell / 2 * (1 + 1e-6)
    components = scipy.ndimage.label(is_open)[0]
    inside = np.where(is_open, (components != components[0, 0, 0]).astype(np.int8), np.int8(-1))
    records = np.zeros((*distance.shape, 4), np.float32)
    field = DistanceField(vertices, faces, tree, low + cell / 2, cell, records, inside)

    away, on_surface = centres - closest, distance[near] <= ON_SURFACE_CELLS * cell
    away[on_surface] = face_cross_products(vertices[faces[face[on_surface]]])  # there is no direction away from it: either side is right
    away = unit_vectors(away)
    sign = np.where(inside == 1, -1.0, 1.0)
    sign[near] = np.where(field._is_inside(closest, away, distance[near]), -1.0, 1.0)
    records[..., 0] = distance * sign
    records[..., 1:][near] = away * sign[near][:, None]
    return field


def _grid_layout(extent: Array, cell: float, band: float) -> tuple[float, float, NDArray[np.int64]]:
    """Compute the side of a cell and the grid's margin around an object of an extent (3,), all in m, and the blocks along each axis."""
    while True:
        margin = band + LOOKUP_ERROR_CELLS * cell  # at least two cells without a surface: the corner is known to be outside
        blocks = np.ceil((extent + 2 * margin) / (cell * BLOCK))
        if blocks.prod() * BLOCK**3 <= MAX_CELLS:
            return cell, margin, blocks.astype(np.int64)
        cell *= 1.05  # a few dozen rounds for the largest objects


def gel_grid(hand: Hand, sensors: Sequence[Sensor]) -> Array:  # (S, PROBES², 3) in the frame of the sensor's link, m
    """Lay points into the gel of every sensor of a hand, at `PROBE_DEPTH`."""
    steps = (np.arange(PROBES) + 0.5) / PROBES - 0.5
    grids = []
    for mount, sensor in zip(hand.sensors, sensors, strict=True):
        x, y = (axis.ravel() for axis in np.meshgrid(steps * sensor.width, steps * sensor.height))
        grids.append(transform_points(mount.pose, np.stack([x, y, np.full_like(x, PROBE_DEPTH * sensor.w)], axis=-1)))
    return np.stack(grids)


def gel_probes(hand: Hand, grid: Array, frames: Array) -> Array32:  # (3, N, S, PROBES²) m
    """Compute where the points of `gel_grid` are in postures, in the frame that their link frames (N, L, 4, 4) are given in."""
    return place_probes(np.ascontiguousarray(frames), np.array([mount.link for mount in hand.sensors]), grid)


def gel_contact(
    field: DistanceField,
    probes: Array32,  # (3, N, S, P) m, from `gel_probes`
    pose: Array = IDENTITY,  # (4, 4) of their frame, world
) -> tuple[Array32, Array32]:  # (N, S) m, (N, S)
    """Measure the least distance of each gel's probes from an object, negative inside, and the share that are inside."""
    return probe_contact(field.grid, probes, pose.astype(np.float32))


def finger_clearance(
    field: DistanceField,
    fingers: Sequence[CollisionSpheres],  # of each of F fingers
    frames: Array,  # (N, L, 4, 4) link frames, world, m
    floor: float = -np.inf,  # m; where the distance is smaller, any value below the floor is returned
) -> Array32:  # (N, F) m, negative inside the object
    """Measure the distance of every finger's rigid links from an object."""
    return np.stack([gaps(field.grid, frames, spheres.single, np.float32(floor)) for spheres in fingers], axis=1)


def penetration_depth(field: DistanceField, spheres: CollisionSpheres, frames: Array) -> float:  # m; 0 when they are apart
    """Compute the depth of the deepest rigid point, by link frames (L, 4, 4), in the object, or of the object's in a rigid link."""
    return max(0.0, -float(near_gaps(field, spheres, frames, 0.0).min(initial=0.0)))


def near_gaps(field: DistanceField, spheres: CollisionSpheres, frames: Array, limit: float) -> Array:  # (K,) m
    """Measure the exact gaps between an object and spheres on link frames (L, 4, 4): all those below a limit, and some others."""
    points, numbers = near_spheres(field.grid, frames, spheres.centres, spheres.radii, spheres.link, limit)
    return field.exact(points) - spheres.radii[numbers]

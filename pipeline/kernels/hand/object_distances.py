"""Distances between a hand and an object: contact of gels, clearance of fingers, and penetration."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Indices
from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.collision_shapes import CollisionSpheres
from pipeline.kernels.hand.distance_field import LOOKUP_ERROR_CELLS, DistanceField
from pipeline.kernels.hand.grid_loops import gaps, least_distances
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor

PROBE_DEPTH = 0.6  # gel thicknesses above the sensor plane that a surface should reach: a firm touch, far from the plane
PROBES = 4  # probe points along a side of the gel: 4 mm apart on a 16 mm gel
IDENTITY = np.eye(4)


@dataclass(frozen=True, eq=False)
class FingerGeometry:
    """The collision spheres of every finger's links, and points in every sensor's gel."""

    spheres: tuple[CollisionSpheres, ...]  # of the links that each of F fingers moves
    probes: Array  # (S, PROBES², 3) in the gel at `PROBE_DEPTH`, in the frame of the sensor's link, m


def finger_geometry(hand: Hand, spheres: CollisionSpheres, sensors: Sequence[Sensor]) -> FingerGeometry:
    """Group a hand's collision spheres by finger and lay probes into the gels of its sensors."""
    by_finger = tuple(spheres.of_links(finger.links) for finger in hand.fingers)
    without_shape = [finger.name for finger, finger_spheres in zip(hand.fingers, by_finger, strict=True) if not len(finger_spheres.radii)]
    if without_shape:
        raise InvalidInput(f"{hand.urdf}: no link of {', '.join(without_shape)} has a collision shape; add one to a link of each finger")
    probes = [transform_points(mount.pose, _probes(sensor)) for mount, sensor in zip(hand.sensors, sensors, strict=True)]
    return FingerGeometry(by_finger, np.stack(probes))


def _probes(sensor: Sensor) -> Array:
    steps = (np.arange(PROBES) + 0.5) / PROBES - 0.5
    x, y = (axis.ravel() for axis in np.meshgrid(steps * sensor.width, steps * sensor.height))
    return np.stack([x, y, np.full_like(x, PROBE_DEPTH * sensor.w)], axis=-1)


def gel_probes(hand: Hand, fingers: FingerGeometry, frames: Array) -> Array32:  # (3, N, S, PROBES²) m
    """Compute the positions of the gels' probe points in postures, in the frame that their link frames (N, L, 4, 4) are given in."""
    points = np.empty((3, len(frames), *fingers.probes.shape[:2]), np.float32)
    _transform_probes(frames, np.array([mount.link for mount in hand.sensors], np.intp), fingers.probes, points)
    return points


@compiled
def _transform_probes(frames: Array, link: Indices, probes: Array, points: Array32) -> None:
    """Fill `points` (3, N, S, P) with probes (S, P, 3) carried by the frames (N, L, 4, 4) of their links (S,)."""
    for axis in range(3):
        for n in range(len(frames)):
            for s in range(len(link)):
                row = frames[n, link[s], axis]
                for p in range(probes.shape[1]):
                    x, y, z = probes[s, p]
                    points[axis, n, s, p] = ((row[0] * x + row[1] * y) + row[2] * z) + row[3]


def gel_contact(
    field: DistanceField,
    probes: Array32,  # (3, N, S, P) m, from `gel_probes`
    pose: Array = IDENTITY,  # (4, 4) of their frame, world
) -> tuple[Array32, Array32]:  # (N, S) m, (N, S)
    """Measure the least distance of each gel's probes from an object, negative inside, and the share that are inside."""
    groups = probes.shape[1:3]
    contact, coverage = least_distances(field.grid, pose.astype(np.float32), probes.reshape(3, -1, probes.shape[3]))
    return contact.reshape(groups), coverage.reshape(groups)


def finger_clearance(
    field: DistanceField,
    fingers: FingerGeometry,
    frames: Array,  # (N, L, 4, 4) link frames, world, m
    floor: float = -np.inf,  # m; where the distance is smaller, any value below the floor is returned
) -> Array32:  # (N, F) m, negative inside the object
    """Measure the distance of every finger's rigid links from an object."""
    return np.stack([gaps(field.grid, frames, finger_spheres.single, np.float32(floor)) for finger_spheres in fingers.spheres], axis=1)


def penetration_depth(field: DistanceField, spheres: CollisionSpheres, frames: Array) -> float:  # m; 0 when they are apart
    """Compute the depth of the deepest rigid point, by link frames (L, 4, 4), in the object, or of the object's in a rigid link."""
    gaps_below = near_gaps(field, spheres, frames, 0.0)
    return max(0.0, -float(gaps_below.min(initial=0.0)))


def near_gaps(field: DistanceField, spheres: CollisionSpheres, frames: Array, limit: float) -> Array:  # (K,) m
    """Measure the exact gaps between an object and spheres on link frames (L, 4, 4): all those below a limit, and some others."""
    points = spheres.world_centres(frames[None])[:, 0]  # (3, B)
    candidates = np.flatnonzero(field.lookup(points.astype(np.float32)) - spheres.radii < limit + LOOKUP_ERROR_CELLS * field.cell)
    return field.exact(points[:, candidates].T) - spheres.radii[candidates]

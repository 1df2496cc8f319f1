"""Pairs of surface points that two fingers could press together: their normals oppose each other within the friction cone."""

from dataclasses import dataclass

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import length, sin_cos, unit_vectors
from pipeline.kernels.hand.distance_field import DistanceField

RAYS = 4000  # rays that are traced from surface points through the object
TILT = 0.25  # standard deviation of a ray's slope against the inward normal: most pairs do not face each other exactly
CONE_SHARE = 0.8  # share of the friction angle by which a normal may be off the line between the points
SELF_HIT = 2e-4  # m from its origin within which a ray meets only the surface that it starts from
BEHIND = 0.003  # m behind a point at which the object must have ended: room for the other finger


@dataclass(frozen=True, eq=False)
class AntipodalPoints:
    """P pairs of surface points, world, m."""

    centre: Array  # (P, 3) between the two points
    axis: Array  # (P, 3) unit vector from the first to the second
    width: Array  # (P,) from the first to the second


def antipodal_points(
    field: DistanceField,
    points: Array,  # (N, 3) on the surface, world, m
    normals: Array,  # (N, 3) unit, outward
    *,
    friction: float,  # coefficient between finger and object
    widest: float,  # m, greatest distance between two points
    rng: np.random.Generator,
) -> AntipodalPoints:
    """Find pairs of points on an object that two fingers could press together (Chen and Burdick, 1993).

    Rays start from random surface points; each place where one leaves the object may give a pair. There may be none.
    """
    start = rng.integers(len(points), size=RAYS)
    origin, outward = points[start], normals[start]
    direction = unit_vectors(-outward + TILT * rng.standard_normal((RAYS, 3)))
    hits = field.tree.intersect_ray(field.vertices, field.faces, origin, direction)
    ray = np.repeat(np.arange(RAYS), [len(ray_hits) for ray_hits in hits])
    face, distance, _, _ = np.array([hit for ray_hits in hits for hit in ray_hits], np.float64).reshape(-1, 4).T
    origin, outward, direction = origin[ray], outward[ray], direction[ray]
    corners = field.vertices[field.faces[face.astype(np.intp)]]
    facing = np.abs((unit_vectors(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])) * direction).sum(axis=1))
    least_cosine = sin_cos(CONE_SHARE * np.arctan(friction))[1]
    end = origin + distance[:, None] * direction
    kept = (distance > SELF_HIT) & (distance <= widest) & (facing >= least_cosine) & (-(outward * direction).sum(axis=1) >= least_cosine)
    kept[kept] = field.lookup((end + BEHIND * direction)[kept].T.astype(np.float32)) > 0
    return AntipodalPoints(((origin + end) / 2)[kept], direction[kept], distance[kept])


def central_weights(
    pairs: AntipodalPoints,
    centre: Array,  # (3,) of mass, world, m
    *,
    spread: float,  # m from the centre, beyond the nearest pairs, at which the weight is a quarter
) -> Array:  # (P,), with sum 1
    """Weigh pairs by their nearness to the centre of mass: gravity turns an object less if it is held there."""
    away = length(pairs.centre - centre)
    excess = np.maximum(away - np.quantile(away, 0.05), 0)  # the object may be hollow at its centre
    weights = (1 + (excess / spread) ** 2) ** -2
    return np.asarray(weights / weights.sum())

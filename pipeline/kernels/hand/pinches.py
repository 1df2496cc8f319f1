"""Pinches: pairs of surface points that two fingers could press together, and postures in which two gels face each other."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Indices
from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.mesh import face_cross_products
from pipeline.kernels.geometry.transforms import length, sin_cos, unit_vectors
from pipeline.kernels.hand.distance_field import DistanceField
from pipeline.kernels.hand.grasp_ik import GraspIk, inner_limits
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.pregrasp import DIFFERENCE_STEP
from pipeline.kernels.hand.self_collision import fingers_apart

RAYS = 4000  # rays that are traced from surface points through the object
TILT = 0.25  # standard deviation of a ray's slope against the inward normal: most pairs do not face each other exactly
CONE_SHARE = 0.8  # share of the friction angle by which a normal may be off the line between the points
SELF_HIT = 2e-4  # m from its origin within which a ray meets only the surface that it starts from
BEHIND = 0.003  # m behind a point at which the object must have ended: room for the other finger
WIDTH_STEP = 0.004  # m of width, of each of which as many postures are kept; each serves widths up to one step away
POSTURES_PER_STEP = 16  # postures kept of each pair of gels and width: enough that palms come from many sides
THINNEST = 0.0005  # m, the thinnest sheet that is pinched; nearer gels cross each other
FACING, SIN_FACING = float(np.sqrt(0.75)), 0.5  # of 30° between normals: two gels with friction 0.5 hold up to it
SIDE, SIDE_SHARE = 0.004, 0.27  # largest distance of one gel from the other's axis, m, and as a share of the width
START_STEPS = 128  # steps of width from which postures start: up to half a metre
ROUGHLY_FACING, ROUGH_SIDE = 0.5, 0.02  # the limits for sampled postures, cosine and m: least squares correct as much
MAX_STEP, TINY = 0.3, 1e-300
ROUNDS, DAMPING = 6, 0.03  # of the damped least squares (Levenberg, 1944) that turn gels towards each other


@dataclass(frozen=True, eq=False)
class AntipodalPoints:
    """P pairs of surface points, world, m."""

    centre: Array  # (P, 3) between the two points
    axis: Array  # (P, 3) unit vector from the first to the second
    width: Array  # (P,) from the first to the second


def antipodal_points(
    field: DistanceField,
    points: Array,  # (N, 3) on the surface, world, m: where rays start, each of which may give pairs
    normals: Array,  # (N, 3) unit, outward
    *,
    friction: float,  # coefficient between finger and object
    widest: float,  # m, greatest distance between two points
    rng: np.random.Generator,
) -> AntipodalPoints:
    """Find pairs of points on an object whose normals oppose each other within the friction cone (Chen and Burdick, 1993)."""
    start = rng.integers(len(points), size=RAYS)
    origin, outward = points[start], normals[start]
    direction = unit_vectors(-outward + TILT * rng.standard_normal((RAYS, 3)))
    hits = field.tree.intersect_ray(field.vertices, field.faces, origin, direction)
    ray = np.repeat(np.arange(RAYS), [len(ray_hits) for ray_hits in hits])
    face, distance, _, _ = np.array([hit for ray_hits in hits for hit in ray_hits], np.float64).reshape(-1, 4).T
    origin, outward, direction = origin[ray], outward[ray], direction[ray]
    corners = field.vertices[field.faces[face.astype(np.intp)]]
    facing = np.abs((unit_vectors(face_cross_products(corners)) * direction).sum(axis=1))
    least_cosine = sin_cos(CONE_SHARE * np.arctan(friction))[1]
    end = origin + distance[:, None] * direction
    kept = (distance > SELF_HIT) & (distance <= widest) & (facing >= least_cosine) & (-(outward * direction).sum(axis=1) >= least_cosine)
    kept[kept] = field.lookup((end + BEHIND * direction)[kept].T.astype(np.float32)) > 0
    return AntipodalPoints(((origin + end) / 2)[kept], direction[kept], distance[kept])


def central_weights(pairs: AntipodalPoints, centre: Array, *, spread: float) -> Array:  # (P,), with sum 1
    """Weigh pairs by their nearness to a centre of mass (3,): a quarter at `spread`, m, beyond the nearest; gravity turns them less."""
    away = length(pairs.centre - centre)
    excess = np.maximum(away - np.quantile(away, 0.05), 0)  # the object may be hollow at its centre
    weights = (1 + (excess / spread) ** 2) ** -2
    return np.asarray(weights / weights.sum())


@dataclass(frozen=True, eq=False)
class OpposedPostures:
    """R postures of two gels that face each other, in the root link's frame."""

    joint_angles: Array  # (R, J) rad; joints of fingers that are not in the pair are at rest
    sensors: Indices  # (R, 2) the pair
    centre: Array  # (R, 3) the middle between the gels, m
    axis: Array  # (R, 3) unit vector from the first to the second
    width: Array  # (R,) between the gels, m
    fault: Array  # (R,) deviation from facing each other; above 1, the gels do not

    def rows(self, rows: Indices) -> "OpposedPostures":
        """Select postures by their numbers, in that order."""
        return OpposedPostures(*(getattr(self, field.name)[rows] for field in fields(self)))


def opposed_postures(ik: GraspIk) -> OpposedPostures:
    """Find postures of two fingers, or of a finger and the palm, whose gels face each other, by ascending width; once per hand.

    Sampled postures of both fingers are paired where the gels roughly face each other, and turned towards each other by least squares; the
    best of each width and pair of gels are kept. There are none for a hand whose fingers meet at an angle, as a claw's do.
    """
    by_pair = [_postures_of_pair(ik, pair) for pair in combinations(range(len(ik.hand.sensors)), 2)]
    if not by_pair:
        raise InvalidInput(f"{ik.hand.name}: one sensor alone cannot hold; use simulate-grasps.search=touch")
    postures = OpposedPostures(*(np.concatenate([getattr(group, field.name) for group in by_pair]) for field in fields(OpposedPostures)))
    return postures.rows(np.argsort(postures.width, kind="stable"))


def _postures_of_pair(ik: GraspIk, pair: tuple[int, int]) -> OpposedPostures:
    """Find the postures of one pair of gels, the best of each width."""
    hand = ik.hand
    fingers = hand.sensor_fingers[list(pair)].tolist()
    rows = _facing_samples(ik, pair, fingers)
    angles = np.tile(np.clip(0.0, hand.lower, hand.upper), (len(rows), 1))
    for finger, samples in zip(fingers, rows.T, strict=True):
        if finger >= 0:
            joints = list(hand.fingers[finger].joints)
            angles[:, joints] = ik.postures.joint_angles[samples][:, joints]
    moving = [joint for finger in dict.fromkeys(fingers) if finger >= 0 for joint in hand.fingers[finger].joints]
    width = np.maximum(_grips(ik, angles, pair).width, THINNEST)
    for _ in range(ROUNDS):
        angles[:, moving] += _step(ik, angles, pair, width, moving)
        angles = np.clip(angles, *inner_limits(hand))
    grips = _grips(ik, angles, pair)
    clear = fingers_apart(hand, ik.boxes, forward_kinematics(hand, np.eye(4), angles), fingers, ik.finger_gap)
    return grips.rows(_best_of_each_width(np.where(clear, grips.fault, np.inf), grips.width))


def _step(ik: GraspIk, angles: Array, pair: tuple[int, int], width: Array, moving: list[int]) -> Array:
    """Compute the step (N, K) of the moving joints, rad, that brings the gels of postures (N, J) nearer to facing each other."""
    nudged = angles[:, None] + DIFFERENCE_STEP * np.eye(angles.shape[1])[moving]  # (N, K, J)
    offsets = _offsets(ik, angles, pair, width)
    nudged_offsets = _offsets(ik, nudged.reshape(-1, angles.shape[1]), pair, np.repeat(width, len(moving))).reshape(*nudged.shape[:2], 6)
    slopes = (nudged_offsets - offsets[:, None]) / DIFFERENCE_STEP  # (N, K, 6)
    step = np.zeros(slopes.shape[:2])
    residual = -np.einsum("nkr,nr->nk", slopes, offsets)
    direction = residual
    for _ in moving:  # conjugate gradients: exact after as many steps as there are joints, and no LAPACK
        image = np.einsum("nkr,nr->nk", slopes, np.einsum("nkr,nk->nr", slopes, direction)) + DAMPING * direction
        squared = (residual**2).sum(axis=1, keepdims=True)
        share = squared / np.maximum((direction * image).sum(axis=1, keepdims=True), TINY)
        step, residual = step + share * direction, residual - share * image
        direction = residual + (residual**2).sum(axis=1, keepdims=True) / np.maximum(squared, TINY) * direction
    return np.clip(step, -MAX_STEP, MAX_STEP)


def _offsets(ik: GraspIk, angles: Array, pair: tuple[int, int], width: Array) -> Array:
    """Compute the deviations (N, 6) of two gels from facing each other across a width (N,), in units of the allowed ones."""
    points, normals = _gels(ik, forward_kinematics(ik.hand, np.eye(4), angles), pair)
    axis = unit_vectors(normals[:, 0] - normals[:, 1])
    return np.hstack([(points[:, 1] - points[:, 0] - width[:, None] * axis) / SIDE, (normals[:, 0] + normals[:, 1]) / SIN_FACING])


def _facing_samples(ik: GraspIk, pair: tuple[int, int], fingers: list[int]) -> Indices:
    """Pair sampled postures (N, 2) of two fingers whose gels roughly face each other; with two motors, only a few of every width."""
    points, normals = _gels(ik, ik.postures.frames, pair)
    samples = np.arange(len(ik.postures.joint_angles))
    first, second = (samples[ik.postures.free[:, finger]] if finger >= 0 else samples[:1] for finger in fingers)
    if fingers[0] == fingers[1]:  # one motor moves both
        together = np.stack([first, first], axis=1)
        return together if fingers[0] >= 0 else together[:0]
    pairs = _facing(points[first, 0], normals[first, 0], points[second, 1], normals[second, 1])
    return np.stack([first[pairs[:, 0]], second[pairs[:, 1]]], axis=1)


@compiled
def _facing(first: Array, first_normals: Array, second: Array, second_normals: Array) -> Indices:
    """Find rows (N, 2) of points (A, 3) and (B, 3) whose normals roughly face each other, `POSTURES_PER_STEP` of every step of width."""
    counts = np.zeros(START_STEPS, np.intp)
    pairs = np.empty((START_STEPS * POSTURES_PER_STEP, 2), np.intp)
    count = 0
    for shift in range(len(second)):  # all pairs, in an order that visits the points of both evenly
        for i in range(len(first)):
            j = (shift + i) % len(second)
            facing, along, squared = 0.0, 0.0, 0.0
            for k in range(3):
                facing -= first_normals[i, k] * second_normals[j, k]
                across = second[j, k] - first[i, k]
                along += across * (first_normals[i, k] - second_normals[j, k]) / 2
                squared += across * across
            if facing < ROUGHLY_FACING or along < 0 or squared - along * along > (ROUGH_SIDE + SIDE_SHARE * along) ** 2:
                continue
            step = int(along / WIDTH_STEP)
            if step < START_STEPS and counts[step] < POSTURES_PER_STEP:
                counts[step] += 1
                pairs[count, 0], pairs[count, 1] = i, j
                count += 1
    return pairs[:count]


def _gels(ik: GraspIk, frames: Array, sensors: Sequence[int]) -> tuple[Array, Array]:
    """Compute the middle points (N, S, 3) of gels at the depth of touches, m, and their outward normals, in the root link's frame."""
    mounts = [ik.hand.sensors[sensor] for sensor in sensors]
    tips = frames[:, [mount.link for mount in mounts]]
    points = np.einsum("nsij,sj->nsi", tips[..., :3, :3], ik.gels[list(sensors)].mean(axis=1)) + tips[..., :3, 3]
    return points, np.einsum("nsij,sj->nsi", tips[..., :3, :3], np.stack([mount.pose[:3, 2] for mount in mounts]))


def _grips(ik: GraspIk, angles: Array, pair: tuple[int, int]) -> OpposedPostures:
    points, normals = _gels(ik, forward_kinematics(ik.hand, np.eye(4), angles), pair)
    facing, across = normals[:, 0] - normals[:, 1], points[:, 1] - points[:, 0]
    axis = unit_vectors(facing)
    width = (across * axis).sum(axis=1)
    side = length(across - width[:, None] * axis) / np.maximum(SIDE, SIDE_SHARE * width)
    turned = (2 - length(facing)) / (2 - np.sqrt(2 + 2 * FACING))
    fault = np.where(width < THINNEST, np.inf, np.maximum(side, turned))
    return OpposedPostures(angles, np.tile(np.array(pair), (len(angles), 1)), points.mean(axis=1), axis, width, fault)


def _best_of_each_width(fault: Array, width: Array) -> Indices:
    """Select the postures (K,) with the least fault of every step of width, if it is below 1."""
    order = np.lexsort((fault, np.floor(width / WIDTH_STEP)))
    order = order[fault[order] < 1]
    step = np.floor(width[order] / WIDTH_STEP)
    rank = np.arange(len(order)) - np.searchsorted(step, step)
    return order[rank < POSTURES_PER_STEP]

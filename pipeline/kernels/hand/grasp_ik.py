"""Inverse kinematics on a distance field: joint angles that bring every gel to the object and keep every rigid link out of it.

Supplement 1.3 has the sensors "meet the surface of the object, so long as physical integration of the hand and object allow it". Where they
meet it is not given, so there is no point to aim at. Instead each finger's joint space is sampled once per hand. The samples are ranked on
the object's distance grid, the best are refined by random steps that shrink, and one posture per finger is chosen so that fingers do not
collide. A posture's value is that of its gel's contact, less what its rigid links lack in clearance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Indices, Mask
from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.collision_shapes import CollisionBoxes, CollisionSpheres, collision_boxes
from pipeline.kernels.hand.distance_field import DistanceField, finger_clearance, gel_contact, gel_grid, gel_probes
from pipeline.kernels.hand.grid_loops import MILLIMETRE, measure_best
from pipeline.kernels.hand.kinematics import combine_frames, forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import choose_postures, finger_conflicts, fingers_clear_of_palm, frequent_overlaps, remedy
from pipeline.kernels.touch.sensor import Sensor

LIMIT_MARGIN, LIMIT_SHARE = 0.01, 0.02  # rad from the limits, for a motor's error; at most this share of the range
EVEN_SAMPLES = 48  # samples measured at every pose, regardless of contact: they decide whether a finger has room
NEAR_CONTACT = 0.0025  # m from the object up to which a sampled posture is a candidate: refinement can correct as much
MAX_CANDIDATES = 320  # sampled postures per finger whose clearance is measured, those with most contact first
REFINED_POSTURES = 12  # postures per finger that are refined side by side, each replaced by its best neighbour
STEPS_PER_POSTURE = 24  # new postures around each of them, per round
STEP, STEP_SHARE = 0.16, 0.1  # of the first round's steps: standard deviation, rad; share of a prismatic joint's range
SHRINK = 0.4  # of each round's steps, relative to the one before
UNTOUCHING_POSTURES = 4  # postures without contact per finger, among which the joint choice may take one


@dataclass(frozen=True, eq=False)
class PostureSamples:
    """Postures spread evenly between the joint limits."""

    joint_angles: Array  # (K, J) rad (m)
    frames: Array  # (K, L, 4, 4) their link frames in the root link's, m
    free: Mask  # (K, F) whether each finger stays clear of the palm and of its own links


def sample_postures(hand: Hand, boxes: CollisionBoxes, *, samples: int, gap: float) -> PostureSamples:
    """Sample a Sobol sequence in each finger's joints; a free finger keeps `gap`, m, from palm and own links."""
    angles = np.empty((samples, len(hand.joint_names)))
    for finger in hand.fingers:
        joints = list(finger.joints)
        unit = scipy.stats.qmc.Sobol(len(joints), scramble=False).random_base2(int(np.ceil(np.log2(samples))))[:samples]
        low, high = (limit[joints] for limit in inner_limits(hand))
        angles[:, joints] = low + unit * (high - low)
    frames = forward_kinematics(hand, np.eye(4), angles)
    return PostureSamples(angles, frames, fingers_clear_of_palm(hand, boxes, frames, gap))


def inner_limits(hand: Hand) -> tuple[Array, Array]:  # (J,) each, rad (m)
    """Compute the limits of planned joint angles: a margin within the joints' own."""
    margin = np.minimum(LIMIT_MARGIN, LIMIT_SHARE * (hand.upper - hand.lower))
    return hand.lower + margin, hand.upper - margin


def even_rows(samples: int) -> Indices:
    """Choose `EVEN_SAMPLES` rows spread evenly over all samples."""
    return np.linspace(0, samples - 1, EVEN_SAMPLES).astype(np.intp)


def blocked_fingers(hand: Hand, boxes: CollisionBoxes, postures: PostureSamples, *, gap: float) -> list[str]:
    """Name the links that rule out every grasp of a hand whose fingers keep a gap, m.

    There is a sentence for each finger that is free of palm and own links in none of the `EVEN_SAMPLES` postures that decide whether it
    has room, and for each two fingers that collide in all pairs of these.
    """
    rows, fingers, free = even_rows(len(postures.free)), hand.fingers, postures.free
    conflicts = finger_conflicts(hand, boxes, postures.frames[rows], gap)
    # what is blocked; the fingers on which overlaps that block it lie, -1 for the palm; what else may be in the way
    blocks: list[tuple[str, tuple[set[int], ...], str]] = [
        (f"{fingers[number].name}: {free[:, number].sum()} of {len(free)} postures", ({number}, {number, -1}), "the palm and its own links")
        for number in np.flatnonzero(~free[rows].any(axis=0)).tolist()
    ]
    blocks += [
        (f"{fingers[a].name} and {fingers[b].name}: 0 of {conflicts[a, b].size} pairs of postures", ({a, b},), "each other's links")
        for a, b in combinations(range(len(fingers)), 2)
        if conflicts[a, b].all()
    ]
    overlaps = frequent_overlaps(hand, boxes, postures.frames, gap) if blocks else []
    sentences = []
    for blocked, owners, otherwise in blocks:
        between = [overlap for overlap in overlaps if set(hand.link_fingers[[overlap.first, overlap.second]].tolist()) in owners]
        pairs = [
            f"{hand.links[overlap.first].name} and {hand.links[overlap.second].name} "
            f"(boxes {'overlap' if overlap.depth > 0 else 'are apart'} {1e3 * abs(overlap.depth):.1f} mm)"
            for overlap in between
        ]
        entries = remedy(hand, between) or "`convex_parts` of hollow links"
        sentences.append(f"{blocked} are free of {', '.join(pairs) or otherwise}: write {entries} into {hand.path}")
    return sentences


@dataclass(frozen=True, eq=False)
class GraspIk:
    """Data of the inverse kinematics, prepared once per hand."""

    hand: Hand
    fingers: tuple[CollisionSpheres, ...]  # of the links that each finger moves
    gels: Array  # (S, P, 3) points in them, as of `gel_grid`
    boxes: CollisionBoxes
    clearance: float  # m, gap that a good posture keeps between rigid links and the object
    finger_gap: float  # m, gap that it keeps between fingers
    postures: PostureSamples  # K of them
    probes: Array32  # (3, K, S, P) their gels' probes in the root link's frame, m


def prepare_grasp_ik(
    hand: Hand,
    spheres: CollisionSpheres,
    sensors: Sequence[Sensor],  # one per mount of the hand
    *,
    samples: int,
    clearance: float,  # m, gap that a good posture keeps between rigid links and the object
    finger_gap: float,  # m, gap that it keeps between fingers
) -> GraspIk:
    """Sample a Sobol sequence in each finger's joints; refuse hands that hardly have a posture without collisions."""
    fingers, gels, boxes = tuple(spheres.of_links(finger.links) for finger in hand.fingers), gel_grid(hand, sensors), collision_boxes(hand)
    if shapeless := [finger.name for finger, own_spheres in zip(hand.fingers, fingers, strict=True) if not len(own_spheres.radii)]:
        raise InvalidInput(f"{hand.model}: no link of {', '.join(shapeless)} has a collision shape; add one to a link of each finger")
    postures = sample_postures(hand, boxes, samples=samples, gap=finger_gap)
    if blocked := blocked_fingers(hand, boxes, postures, gap=finger_gap):
        raise InvalidInput("; ".join(blocked))
    return GraspIk(hand, fingers, gels, boxes, clearance, finger_gap, postures, gel_probes(hand, gels, postures.frames))


def fingers_fit(ik: GraspIk, field: DistanceField, hand_pose: Array) -> bool:
    """Decide whether every finger of a hand at a pose (4, 4) has a posture, among a few samples, clear of object and palm."""
    rows = even_rows(len(ik.postures.frames))
    contact_values = np.where(ik.postures.free[rows], np.float32(0), -np.inf)
    return bool(_measure_best(ik, field, compose(hand_pose, ik.postures.frames[rows]), contact_values, clear=1)[1].any(axis=0).all())


@dataclass(frozen=True, eq=False)
class GraspChoices:
    """Choices of one posture per finger that keep the fingers apart, best first; there may be none."""

    hand: Hand
    options: Array  # (O, J) rad, joint angles in each of which every finger has a posture
    frames: Array  # (O, L, 4, 4) their link frames, world
    picks: Indices  # (N, F) option that each finger takes

    def joint_angles(self, number: int) -> Array:
        """Combine the fingers' postures of a choice, (J,), rad."""
        return np.asarray(_combine_fingers(self.hand, self.options, self.picks[number][None])[0])


def grasp_ik(
    ik: GraspIk,
    field: DistanceField,
    hand_pose: Array,  # (4, 4) of the root link, world, m
    *,
    rounds: int,  # of refinement
    rng: np.random.Generator,
    start: Array | None = None,  # (J,) rad, a posture to refine beside the best samples
) -> GraspChoices:
    """Find joint angles, within the limits, with which the sensors touch an object.

    There are none where some finger has no posture that is clear of object and hand. A finger that cannot touch takes, of the free
    postures, the one that comes nearest to touching.
    """
    postures, untouching = _best_samples(ik, field, hand_pose)
    if start is not None:
        postures = np.concatenate([postures, start[None]])
    slides = np.array([ik.hand.joints[link - 1].kind == "prismatic" for link in ik.hand.joint_links])
    size = np.where(slides, STEP_SHARE * (ik.hand.upper - ik.hand.lower), STEP)
    for k in range(rounds):
        steps = size * SHRINK**k * rng.standard_normal((len(postures), STEPS_PER_POSTURE + 1, postures.shape[1]))
        postures = _refine(ik, field, hand_pose, postures=postures, steps=steps)
    options = np.concatenate([postures, untouching])
    frames = forward_kinematics(ik.hand, hand_pose, options)
    clear = finger_clearance(field, ik.fingers, frames, floor=ik.clearance) >= ik.clearance
    values = np.where(clear, _contact_values(ik, field, frames), -np.inf)
    at_origin = forward_kinematics(ik.hand, np.eye(4), options)
    values[~fingers_clear_of_palm(ik.hand, ik.boxes, at_origin, ik.finger_gap)] = -np.inf
    return GraspChoices(ik.hand, options, frames, choose_postures(ik.hand, ik.boxes, frames=frames, values=values, gap=ik.finger_gap))


def _contact_values(ik: GraspIk, field: DistanceField, frames: Array) -> Array32:
    """Compute the values (N, F), more than 1 per touch, of postures with clearance, from frames (N, L, 4, 4)."""
    contact, coverage = gel_contact(field, gel_probes(ik.hand, ik.gels, frames))
    miss = np.maximum(contact, 0) / MILLIMETRE
    return _by_finger(ik.hand, np.where(miss == 0, 2 + coverage, 0) - 0.1 * miss)


def _measure_best(
    ik: GraspIk, field: DistanceField, frames: Array, contact: Array32, *, groups: int = 1, best: int = 0, clear: int = 0
) -> tuple[Array32, Mask]:
    """Compute the values (N, F) of the best postures of each group, and find clear ones (N, F): see `measure_best`."""
    by_finger = np.ascontiguousarray(contact.T)
    ranks = np.argsort(-by_finger.reshape(len(by_finger), groups, -1), axis=-1, kind="stable")
    order = np.insert(ranks, 0, 0, axis=-1) + ranks.shape[-1] * np.arange(groups)[:, None]  # the first of a group is the posture to improve
    measured = [
        measure_best(field.grid, frames, spheres.single, by_finger[f], order[f], best, clear, np.float32(ik.clearance))
        for f, spheres in enumerate(ik.fingers)
    ]
    value, is_clear = (np.stack(columns, axis=1) for columns in zip(*measured, strict=True))
    return value, is_clear


def _by_finger(hand: Hand, gains: NDArray[Any]) -> NDArray[Any]:
    """Sum gains (N, S) over the sensors of each finger, (N, F); 0 for a finger without sensors."""
    return np.stack([gains[:, list(finger.sensors)].sum(axis=1) for finger in hand.fingers], axis=1)


def _best_samples(ik: GraspIk, field: DistanceField, hand_pose: Array) -> tuple[Array, Array]:
    """Choose the samples to refine (REFINED_POSTURES, J) and those for fingers that cannot touch (UNTOUCHING_POSTURES, J)."""
    rows = _candidates(ik, field, hand_pose)
    # a link that no finger moves has the same frame in all
    frames = combine_frames(hand_pose, ik.postures.frames, np.ascontiguousarray(rows[:, ik.hand.link_fingers]))
    contact = np.where(np.take_along_axis(ik.postures.free, rows, axis=0), _contact_values(ik, field, frames), -np.inf)
    value, is_clear = _measure_best(ik, field, frames, contact, best=REFINED_POSTURES, clear=UNTOUCHING_POSTURES)
    clear_value = np.where(is_clear, value, -np.inf)
    best = np.argsort(-value, axis=0, kind="stable")[:REFINED_POSTURES]
    clearest = np.argsort(-clear_value, axis=0, kind="stable")[:UNTOUCHING_POSTURES]
    angles = _combine_fingers(ik.hand, ik.postures.joint_angles, rows)
    return _combine_fingers(ik.hand, angles, best), _combine_fingers(ik.hand, angles, clearest)


def _candidates(ik: GraspIk, field: DistanceField, hand_pose: Array) -> Indices:
    """Select the samples whose clearance is measured, (MAX_CANDIDATES + EVEN_SAMPLES, F) rows: by contact, and an even spread."""
    contact, coverage = gel_contact(field, ik.probes, hand_pose)  # (K, S)
    excess = np.maximum(np.abs(contact + NEAR_CONTACT) - NEAR_CONTACT, 0) / MILLIMETRE
    scores = np.where(ik.postures.free, _by_finger(ik.hand, coverage - excess), -np.inf)
    order = np.argsort(-scores, axis=0, kind="stable")[:MAX_CANDIDATES]
    spread = even_rows(len(ik.postures.frames))
    return np.concatenate([order, np.broadcast_to(spread[:, None], (len(spread), order.shape[1]))])


def _combine_fingers(hand: Hand, angles: Array, rows: Indices) -> Array:
    """Combine joint angles (N, J), in which finger s takes row `rows[:, s]` of `angles`."""
    return np.take_along_axis(angles, rows[:, hand.link_fingers[list(hand.joint_links)]], axis=0)


def _refine(ik: GraspIk, field: DistanceField, hand_pose: Array, *, postures: Array, steps: Array) -> Array:
    """Replace each of P postures (P, J), finger by finger, by the best of itself and its neighbours at `steps` (P, …, J)."""
    children = postures[:, None] + steps
    children[:, 0] = postures
    children = np.clip(children, *inner_limits(ik.hand)).reshape(-1, postures.shape[1])
    frames = forward_kinematics(ik.hand, hand_pose, children)
    value, _ = _measure_best(ik, field, frames, _contact_values(ik, field, frames), groups=len(postures), best=1)
    best = value.reshape(len(postures), STEPS_PER_POSTURE + 1, -1).argmax(axis=1)  # (REFINED_POSTURES, F)
    return _combine_fingers(ik.hand, children, best + (STEPS_PER_POSTURE + 1) * np.arange(len(postures))[:, None])

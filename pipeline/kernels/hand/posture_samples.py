"""Samples of a hand's postures, and the overlaps that rule them out."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Indices, Mask
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import LinkOverlap, finger_conflicts, fingers_clear_of_palm, frequent_overlaps, remedy

LIMIT_MARGIN, LIMIT_SHARE = 0.01, 0.02  # rad from the limits, for a motor's error; at most this share of the range
EVEN_SAMPLES = 48  # samples measured at every pose, regardless of contact: they decide whether a finger has room


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
        margin = limit_margin(hand)[joints]
        low, high = hand.lower[joints] + margin, hand.upper[joints] - margin
        angles[:, joints] = low + unit * (high - low)
    frames = forward_kinematics(hand, np.eye(4), angles)
    return PostureSamples(angles, frames, fingers_clear_of_palm(hand, boxes, frames, gap))


def limit_margin(hand: Hand) -> Array:
    """Compute the distance kept from the joint limits, (J,), rad (m)."""
    return np.minimum(LIMIT_MARGIN, LIMIT_SHARE * (hand.upper - hand.lower))


def even_rows(samples: int) -> Indices:
    """Choose `EVEN_SAMPLES` rows spread evenly over all samples."""
    return np.linspace(0, samples - 1, EVEN_SAMPLES).astype(np.intp)


def blocked_fingers(hand: Hand, boxes: CollisionBoxes, postures: PostureSamples, *, gap: float) -> list[str]:
    """Name the links that rule out every grasp of a hand whose fingers keep a gap, m.

    There is a sentence for each finger that is free of palm and own links in none of the `EVEN_SAMPLES` postures that decide whether it
    has room, and for each two fingers that collide in all pairs of these.
    """
    rows, fingers = even_rows(len(postures.free)), hand.fingers
    conflicts = finger_conflicts(hand, boxes, postures.frames[rows], gap)
    stuck = [number for number in range(len(fingers)) if not postures.free[rows, number].any()]
    entangled = [pair for pair in combinations(range(len(fingers)), 2) if conflicts[pair].all()]
    overlaps = frequent_overlaps(hand, boxes, postures.frames, gap) if stuck or entangled else []
    sentences = []
    for number in stuck:
        beginning = f"{fingers[number].name}: {postures.free[:, number].sum()} of {len(postures.free)} postures are free of"
        sentences.append(_sentence(hand, beginning, _between(hand, overlaps, {number}, {number, -1}), "the palm and its own links"))
    for first, second in entangled:
        beginning = f"{fingers[first].name} and {fingers[second].name}: 0 of {conflicts[first, second].size} pairs of postures are free of"
        sentences.append(_sentence(hand, beginning, _between(hand, overlaps, {first, second}), "each other's links"))
    return sentences


def _between(hand: Hand, overlaps: list[LinkOverlap], *fingers: set[int]) -> list[LinkOverlap]:
    """Select the overlaps between links of these fingers; -1 is the palm."""
    return [overlap for overlap in overlaps if {int(hand.link_fingers[link]) for link in (overlap.first, overlap.second)} in fingers]


def _sentence(hand: Hand, beginning: str, overlaps: list[LinkOverlap], otherwise: str) -> str:
    """Describe the links in the way, and what to write into the hand file."""
    pairs = [
        f"{hand.links[overlap.first].name} and {hand.links[overlap.second].name} "
        f"(boxes {'overlap' if overlap.depth > 0 else 'are apart'} {1e3 * abs(overlap.depth):.1f} mm)"
        for overlap in overlaps
    ]
    remedies = {remedy(hand, overlap): None for overlap in overlaps} or {"`convex_parts` of hollow links": None}
    return f"{beginning} {', '.join(pairs) or otherwise}: write {', '.join(remedies)} into {hand.path}"

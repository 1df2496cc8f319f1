"""Inverse kinematics on a distance field: joint angles that bring every gel to the object and keep every rigid part out of it.

Supplement 1.3 has the sensors "meet the surface of the object, so long as physical integration of the hand and object allow it". Where
they meet it is not given, so there is no point to aim at. Instead each finger's joint space is sampled once a hand; on an object's
distance grid the samples are told apart; the best are refined by random steps that shrink; and one posture a finger is chosen so that no
two are in each other's way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from pipeline.kernels.hand.bodies import Boxes
from pipeline.kernels.hand.choice import choose_together, fingers_free_of_palm
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.hand.kinematics import forward
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.reach import FingerParts, finger_clearance, gel_contact, gel_probes, judge

MILLIMETRE = 1e-3
LIMIT_MARGIN = 0.01
"""rad (m) kept from the joint limits, so that a motor's residue does not cross them."""
NEAR_CONTACT = 0.0025
"""m outside or inside the wanted contact up to which a sampled posture is looked at: what refinement can make good."""
LOOKED_AT = 320
"""Sampled postures a finger whose clearance is computed, those with most contact first."""
SPREAD = 48
"""Sampled postures looked at whatever they touch: among them are those for a finger that cannot touch."""
LINES = 12
"""Postures a finger that are refined side by side, each replaced by its best neighbour."""
NEIGHBOURS = 24
"""New postures around each of them, a round."""
STEP = 0.16
"""rad, standard deviation of the first round's steps, about the distance between samples; each round's is `SHRINK` of the one before."""
SHRINK = 0.4
AT_REST = 4
"""Postures without contact a finger, among which the joint choice may take one."""


@dataclass(frozen=True, eq=False)
class PostureSamples:
    """Joint angles (K, J) spread evenly between the limits, their link frames (K, L, 4, 4) in the root link's, the gels' probes
    (3, K, S, P), and which of them keep each finger (K, S) out of the palm."""

    joint_angles: NDArray[np.float64]
    frames: NDArray[np.float64]
    probes: NDArray[np.float32]
    free: NDArray[np.bool_]


@dataclass(frozen=True)
class Wanted:
    """What a good posture has: rigid `clearance` from the object, `gap` between fingers, and a probe within `contact` of the object; m."""

    clearance: float
    gap: float
    contact: float


def sample_postures(hand: Hand, parts: FingerParts, boxes: Boxes, count: int, gap: float) -> PostureSamples:
    """A Sobol sequence in each finger's joints, once a hand."""
    angles = np.empty((count, len(hand.joint_names)))
    for finger in hand.fingers:
        joints = list(finger.joints)
        unit = qmc.Sobol(len(joints), scramble=False).random_base2(int(np.ceil(np.log2(count))))[:count]
        low, high = hand.lower[joints] + LIMIT_MARGIN, hand.upper[joints] - LIMIT_MARGIN
        angles[:, joints] = low + unit * (high - low)
    frames = forward(hand, np.eye(4), angles)
    return PostureSamples(angles, frames, gel_probes(hand, parts, frames), fingers_free_of_palm(hand, boxes, frames, gap))


def has_room(
    hand: Hand, parts: FingerParts, samples: PostureSamples, field: DistanceField, pose: NDArray[np.float64], clearance: float
) -> bool:
    """Whether every finger of a hand at `pose` (4, 4) has, among some samples, one that keeps `clearance` from the object, m."""
    rows = np.linspace(0, len(samples.joint_angles) - 1, SPREAD).astype(np.intp)
    clear = finger_clearance(field, parts, pose @ samples.frames[rows]) >= clearance
    return bool((clear & samples.free[rows]).any(axis=0).all())


def solve(
    hand: Hand,
    parts: FingerParts,
    boxes: Boxes,
    samples: PostureSamples,
    field: DistanceField,
    pose: NDArray[np.float64],
    wanted: Wanted,
    rounds: int,
    rng: np.random.Generator,
) -> NDArray[np.float64] | None:
    """Joint angles (J,) for a hand at `pose` (4, 4), or None when some finger has no posture that is free of object and hand.

    A finger that cannot touch takes, of the free postures found, the one that comes nearest to touching.
    """
    lines, rest = _from_samples(hand, parts, samples, field, pose, wanted)
    for k in range(rounds):
        lines = _refine(hand, parts, boxes, field, pose, wanted, lines, STEP * SHRINK**k, rng)
    options = np.concatenate([lines, rest])
    worth = _worth(hand, parts, field, forward(hand, pose, options), wanted)
    worth[~fingers_free_of_palm(hand, boxes, forward(hand, np.eye(4), options), wanted.gap)] = -np.inf
    picks = choose_together(hand, boxes, forward(hand, pose, options), worth, wanted.gap)
    if picks is None:
        return None
    chosen = np.empty(len(hand.joint_names))
    for s, finger in enumerate(hand.fingers):
        chosen[list(finger.joints)] = options[picks[s], list(finger.joints)]
    return chosen


def _worth(hand: Hand, parts: FingerParts, field: DistanceField, frames: NDArray[np.float64], wanted: Wanted) -> NDArray[np.float64]:
    """(N, S) worth of postures: more than 1 for a touch, less the further from one, -inf for what stands in the object."""
    value, clearance = _value(hand, parts, field, frames, wanted)
    return np.where(clearance >= wanted.clearance, value, -np.inf)


def _value(
    hand: Hand, parts: FingerParts, field: DistanceField, frames: NDArray[np.float64], wanted: Wanted
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    seen = judge(hand, parts, field, frames, wanted.contact)
    miss = np.maximum(seen.contact - wanted.contact, 0) / MILLIMETRE
    touch = np.where(miss == 0, 2 + seen.coverage, 0)
    lack = np.maximum(wanted.clearance - seen.clearance, 0) / MILLIMETRE
    return (touch - 0.1 * miss - 2 * lack).astype(np.float64), seen.clearance.astype(np.float64)


def _from_samples(
    hand: Hand, parts: FingerParts, samples: PostureSamples, field: DistanceField, pose: NDArray[np.float64], wanted: Wanted
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The best samples to refine (LINES, J) and those for fingers that cannot touch (AT_REST, J); fingers mix freely."""
    rows = looked_at(samples, field, pose, wanted)
    angles, frames = _mix(hand, samples, rows, pose)
    value, clearance = _value(hand, parts, field, frames, wanted)
    free = np.take_along_axis(samples.free, rows, axis=0)
    value = np.where(free, value, -np.inf)
    calm = np.where(clearance >= wanted.clearance, value, -np.inf)
    return _best(hand, angles, value, LINES), _best(hand, angles, calm, AT_REST)


def looked_at(samples: PostureSamples, field: DistanceField, pose: NDArray[np.float64], wanted: Wanted) -> NDArray[np.intp]:
    """(LOOKED_AT + SPREAD, S) rows of `samples` whose clearance is computed: each finger's with most contact, and some of all."""
    turned = np.tensordot(pose[:3, :3].astype(np.float32), samples.probes, axes=1) + pose[:3, 3].astype(np.float32)[:, None, None, None]
    contact, coverage = gel_contact(field, turned, wanted.contact)  # (K, S)
    excess = np.maximum(np.abs(contact - wanted.contact + NEAR_CONTACT) - NEAR_CONTACT, 0) / MILLIMETRE
    first = np.where(samples.free, coverage - excess, -np.inf)
    order = np.argsort(-first, axis=0, kind="stable")[:LOOKED_AT]
    spread = np.linspace(0, len(first) - 1, SPREAD).astype(np.intp)
    return np.concatenate([order, np.broadcast_to(spread[:, None], (len(spread), order.shape[1]))])


def _mix(
    hand: Hand, samples: PostureSamples, rows: NDArray[np.intp], pose: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles (N, J) and world frames (N, L, 4, 4) in which finger s takes sample `rows[:, s]`."""
    angles = np.empty((len(rows), samples.joint_angles.shape[1]))
    frames = samples.frames[rows[:, 0]]
    for s, finger in enumerate(hand.fingers):
        angles[:, list(finger.joints)] = samples.joint_angles[rows[:, s]][:, list(finger.joints)]
        frames[:, list(finger.links)] = samples.frames[rows[:, s]][:, list(finger.links)]
    return angles, pose @ frames


def _best(hand: Hand, angles: NDArray[np.float64], value: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(count, J): each finger's best postures, by (N, S) value."""
    order = np.argsort(-value, axis=0, kind="stable")[:count]
    best = np.empty((count, angles.shape[1]))
    for s, finger in enumerate(hand.fingers):
        best[:, list(finger.joints)] = angles[order[:, s]][:, list(finger.joints)]
    return best


def _refine(
    hand: Hand,
    parts: FingerParts,
    boxes: Boxes,
    field: DistanceField,
    pose: NDArray[np.float64],
    wanted: Wanted,
    lines: NDArray[np.float64],
    step: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Every line's best posture among itself and random neighbours, finger by finger."""
    children = lines[:, None] + step * rng.standard_normal((len(lines), NEIGHBOURS + 1, lines.shape[1]))
    children[:, 0] = lines
    children = np.clip(children, hand.lower + LIMIT_MARGIN, hand.upper - LIMIT_MARGIN)
    frames = forward(hand, pose, children.reshape(-1, lines.shape[1]))
    value = _value(hand, parts, field, frames, wanted)[0].reshape(len(lines), NEIGHBOURS + 1, -1)
    best = value.argmax(axis=1)  # (LINES, S)
    refined = lines.copy()
    for s, finger in enumerate(hand.fingers):
        joints = list(finger.joints)
        refined[:, joints] = children[np.arange(len(lines)), best[:, s]][:, joints]
    return refined

"""Inverse kinematics on a distance field: joint angles that bring every gel to the object and keep every rigid part out of it.

Supplement 1.3 has the sensors "meet the surface of the object, so long as physical integration of the hand and object allow it". Where
they meet it is not given, so there is no point to aim at. Instead each finger's joint space is sampled once a hand; on an object's
distance grid the samples are told apart; the best are refined by random steps that shrink; and one posture a finger is chosen so that no
two are in each other's way.

A posture's value is that of its gel's contact, less what its rigid parts lack in room. The contact takes a few look-ups and bounds the
value, the tip's room a few more and bounds it better; the other links, most of the look-ups, are looked at only where that leaves a
posture a chance. What comes out is the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.bodies import Boxes
from pipeline.kernels.hand.choice import choose_together, fingers_free_of_palm
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.hand.kinematics import forward
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.reach import FingerParts, clearance_of, finger_clearance, gel_contact, gel_probes

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
A_FEW = 4
"""Sampled postures that are looked at before it is asked whether every finger has room: most often they do."""
AT_ONCE = 24
"""Sampled postures a finger that are measured before it is asked whether others have a chance: twice as many as are kept."""


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


@dataclass(frozen=True, eq=False)
class Solution:
    """Joint angles (J,), None where there are none; and for how many postures of a finger the room was measured, or need not be."""

    joint_angles: NDArray[np.float64] | None
    measured: int
    spared: int


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
    without = np.ones(samples.free.shape[1], bool)
    for some in np.array_split(rows, SPREAD // A_FEW):
        asked = samples.free[some] & without
        frames = compose(pose, samples.frames[some])
        asked &= clearance_of(parts.tips, field, frames, asked) >= clearance
        without &= ~(asked & (clearance_of(parts.others, field, frames, asked) >= clearance)).any(axis=0)
        if not without.any():
            return True
    return False


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
) -> Solution:
    """Joint angles (J,) for a hand at `pose` (4, 4), or None when some finger has no posture that is free of object and hand.

    A finger that cannot touch takes, of the free postures found, the one that comes nearest to touching.
    """
    lines, rest, asked = _from_samples(hand, parts, samples, field, pose, wanted)
    looks = [asked]
    for k in range(rounds):
        lines, asked = _refine(hand, parts, field, pose, wanted, lines, STEP * SHRINK**k, rng)
        looks.append(asked)
    options = np.concatenate([lines, rest])
    frames = forward(hand, pose, options)
    room = finger_clearance(field, parts, frames)
    worth = np.where(room >= wanted.clearance, _value(_bound(hand, parts, field, frames, wanted), room, wanted), -np.inf)
    worth[~fingers_free_of_palm(hand, boxes, forward(hand, np.eye(4), options), wanted.gap)] = -np.inf
    picks = choose_together(hand, boxes, frames, worth, wanted.gap)
    measured = sum(int(asked.sum()) for asked in looks)
    spared = sum(asked.size for asked in looks) - measured
    return Solution(None if picks is None else _picked(hand, options, picks), measured, spared)


def _picked(hand: Hand, options: NDArray[np.float64], rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """Joint angles (J,) in which every finger takes its row of `options` (O, J)."""
    chosen = np.empty(options.shape[1])
    for s, finger in enumerate(hand.fingers):
        chosen[list(finger.joints)] = options[rows[s], list(finger.joints)]
    return chosen


def _bound(hand: Hand, parts: FingerParts, field: DistanceField, frames: NDArray[np.float64], wanted: Wanted) -> NDArray[np.float32]:
    """(N, S) the value of postures if their rigid parts have room: more than 1 for a touch, less the further from one."""
    contact, coverage = gel_contact(field, gel_probes(hand, parts, frames), wanted.contact)
    miss = np.maximum(contact - wanted.contact, 0) / MILLIMETRE
    bound: NDArray[np.float32] = np.where(miss == 0, 2 + coverage, 0) - 0.1 * miss
    return bound


def _value(bound: NDArray[np.float32], clearance: NDArray[np.float32], wanted: Wanted) -> NDArray[np.float64]:
    """(N, S) the value of postures whose rigid parts are so far from the object: never above the bound."""
    lack = np.maximum(wanted.clearance - clearance, 0) / MILLIMETRE
    value: NDArray[np.float64] = (bound - 2 * lack).astype(np.float64)
    return value


def _from_samples(
    hand: Hand, parts: FingerParts, samples: PostureSamples, field: DistanceField, pose: NDArray[np.float64], wanted: Wanted
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """The best samples to refine (LINES, J) and those for fingers that cannot touch (AT_REST, J); fingers mix freely.

    Postures are measured in the order of their bounds until none that is left can be among a finger's best. Also returned is
    which were, (N, S).
    """
    rows = looked_at(samples, field, pose, wanted)
    angles, frames = _mix(hand, samples, rows, pose)
    free = np.take_along_axis(samples.free, rows, axis=0)
    contact = np.where(free, _bound(hand, parts, field, frames, wanted), -np.inf)
    tip = clearance_of(parts.tips, field, frames, free)
    bound = _value(contact, tip, wanted)
    calm_bound = np.where(tip >= wanted.clearance, bound, -np.inf)
    value, calm = np.full(bound.shape, -np.inf), np.full(bound.shape, -np.inf)
    measured = np.zeros(bound.shape, bool)
    order = np.argsort(-bound, axis=0, kind="stable")
    for first in range(0, len(order), AT_ONCE):
        chance = free & ~measured & ((bound >= _nth(value, LINES)) | (calm_bound >= _nth(calm, AT_REST)))
        if not chance.any():
            break
        asked = np.zeros(bound.shape, bool)
        np.put_along_axis(asked, order[first : first + AT_ONCE], chance.any(axis=0), axis=0)
        asked &= free
        clearance = np.minimum(tip, clearance_of(parts.others, field, frames, asked))
        value = np.where(asked, _value(contact, clearance, wanted), value)
        calm = np.where(asked & (clearance >= wanted.clearance), value, calm)
        measured |= asked
    return _best(hand, angles, value, LINES), _best(hand, angles, calm, AT_REST), measured


def _nth(value: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(S,) the value of each finger's posture number `count`, best first, of (N, S)."""
    nth: NDArray[np.float64] = np.partition(value, -count, axis=0)[-count]
    return nth


def looked_at(samples: PostureSamples, field: DistanceField, pose: NDArray[np.float64], wanted: Wanted) -> NDArray[np.intp]:
    """(LOOKED_AT + SPREAD, S) rows of `samples` whose clearance is computed: each finger's with most contact, and some of all."""
    turn, shift = pose[:3, :3].astype(np.float32), pose[:3, 3].astype(np.float32)
    turned = np.einsum("ij,jksp->iksp", turn, samples.probes) + shift[:, None, None, None]
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
    return angles, compose(pose, frames)


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
    field: DistanceField,
    pose: NDArray[np.float64],
    wanted: Wanted,
    lines: NDArray[np.float64],
    step: float,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Every line's best posture among itself and random neighbours, finger by finger; and which were measured, (LINES, 1 + NEIGHBOURS, S).

    A neighbour whose bound is not above the line's own value is not better, whatever room it has.
    """
    children = lines[:, None] + step * rng.standard_normal((len(lines), NEIGHBOURS + 1, lines.shape[1]))
    children[:, 0] = lines
    children = np.clip(children, hand.lower + LIMIT_MARGIN, hand.upper - LIMIT_MARGIN)
    frames = forward(hand, pose, children)  # (LINES, 1 + NEIGHBOURS, L, 4, 4)
    flat = frames.reshape(-1, *frames.shape[2:])
    bound = _bound(hand, parts, field, flat, wanted).reshape(*children.shape[:2], -1)
    own = _value(bound[:, 0], finger_clearance(field, parts, frames[:, 0]), wanted)
    asked = bound > own[:, None]
    asked[:, 0] = False
    tip = clearance_of(parts.tips, field, flat, asked.reshape(len(flat), -1)).reshape(bound.shape)
    asked &= _value(bound, tip, wanted) > own[:, None]
    others = clearance_of(parts.others, field, flat, asked.reshape(len(flat), -1)).reshape(bound.shape)
    value = np.where(asked, _value(bound, np.minimum(tip, others), wanted), -np.inf)
    value[:, 0], asked[:, 0] = own, True
    best = value.argmax(axis=1)  # (LINES, S)
    refined = lines.copy()
    for s, finger in enumerate(hand.fingers):
        joints = list(finger.joints)
        refined[:, joints] = children[np.arange(len(lines)), best[:, s]][:, joints]
    return refined, asked

"""Collisions of a hand with itself: gaps between boxes, overlaps to allow or to report, and postures that avoid them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand

Float64Array = NDArray[np.float64]
Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]

PARALLEL_SINE2 = 1e-6
"""Squared sine below which two edges count as parallel: their cross product is no axis, and the axes of the faces are enough."""
BEAM_WIDTH = 256
"""Partial choices that are carried from finger to finger."""
MAX_NEIGHBOUR_JOINTS = 2
"""Most moving joints between a link and its descendant that still count as neighbours: a knuckle has two."""
FREQUENT_SHARE = 0.5
"""Share of the postures in which a pair must overlap to be reported."""


@dataclass(frozen=True)
class LinkOverlap:
    """Two links whose boxes overlap in a share of postures, by `depth` m in the median of those; they are apart where it is negative."""

    first: int
    second: int
    share: float
    depth: float


@compiled
def box_gap(frame_a: Float64Array, half_a: Float64Array, frame_b: Float64Array, half_b: Float64Array, enough: float = np.inf) -> float:
    """Compute the largest gap between two boxes along any of the 15 candidate axes.

    Parameters
    ----------
    frame_a, frame_b
        (4, 4) poses of the boxes' centres, m.
    half_a, half_b
        (3,) half extents, m.
    enough
        m, a gap that is as good as any larger one: the search ends there.

    Returns
    -------
    m: a lower bound of the distance of boxes that are apart; of boxes that overlap, minus their least overlap.
    """
    rotation, size, shift = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    gap = -np.inf
    x, y, z = frame_b[0, 3] - frame_a[0, 3], frame_b[1, 3] - frame_a[1, 3], frame_b[2, 3] - frame_a[2, 3]
    for i in range(3):  # the axes of a
        for k in range(3):
            rotation[i, k] = frame_a[0, i] * frame_b[0, k] + frame_a[1, i] * frame_b[1, k] + frame_a[2, i] * frame_b[2, k]
            size[i, k] = abs(rotation[i, k])
        shift[i] = frame_a[0, i] * x + frame_a[1, i] * y + frame_a[2, i] * z
        gap = max(gap, abs(shift[i]) - half_a[i] - (size[i, 0] * half_b[0] + size[i, 1] * half_b[1] + size[i, 2] * half_b[2]))
    if gap >= enough:
        return gap
    for k in range(3):  # the axes of b
        along = abs(rotation[0, k] * shift[0] + rotation[1, k] * shift[1] + rotation[2, k] * shift[2])
        gap = max(gap, along - half_b[k] - (size[0, k] * half_a[0] + size[1, k] * half_a[1] + size[2, k] * half_a[2]))
    if gap >= enough:
        return gap
    for i in range(3):  # the cross products of two
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            sine2 = 1 - rotation[i, k] ** 2
            if sine2 > PARALLEL_SINE2:
                k1, k2 = (k + 1) % 3, (k + 2) % 3
                distance = abs(shift[i2] * rotation[i1, k] - shift[i1] * rotation[i2, k])
                extent = half_a[i1] * size[i2, k] + half_a[i2] * size[i1, k]
                extent = extent + half_b[k1] * size[i, k2] + half_b[k2] * size[i, k1]
                gap = max(gap, (distance - extent) / np.sqrt(sine2))
    return gap


def hand_gap(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64]) -> float:
    """Compute the least gap between links of a hand that no joint connects.

    Parameters
    ----------
    hand
        L links.
    boxes
        Their boxes, from `collision_boxes`.
    frames
        (L, 4, 4) float64 link frames of one posture, any common frame, m.

    Returns
    -------
    m, from `box_gap`: negative where links overlap, +inf where no two can meet.
    """
    return _least_gap(_world_boxes(boxes, frames), boxes.half, *_pairs(hand, boxes))


@compiled
def _least_gap(world: Float64Array, half: Float64Array, first: NDArray[np.intp], second: NDArray[np.intp]) -> float:
    """Least gap of pairs of boxes; inf where there are none."""
    least = np.inf
    for a, b in zip(first, second):  # noqa: B905 - as numba has it
        least = min(least, box_gap(world[a], half[a], world[b], half[b], least))
    return least


def rigid_bodies(hand: Hand) -> NDArray[np.intp]:
    """Compute the body of each link, (L,), numbered by the body's first link: fixed joints connect links to one body."""
    moving = {*hand.joint_links, *(follower.link for follower in hand.followers)}
    bodies = np.arange(len(hand.links))
    for joint in hand.joints:  # parents first
        if joint.child not in moving:
            bodies[joint.child] = bodies[joint.parent]
    return bodies


def fingers_clear_of_palm(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64], gap: float) -> NDArray[np.bool_]:
    """Find the fingers that keep a gap from their own links and from those that no finger moves.

    Parameters
    ----------
    hand, boxes
        The hand and its boxes, from `collision_boxes`.
    frames
        (N, L, 4, 4) link frames.
    gap
        m.

    Returns
    -------
    (N, F) bool.
    """
    first, second = _pairs(hand, boxes)
    owner = hand.link_fingers[boxes.link]
    own = (owner[first] == owner[second]) | (np.minimum(owner[first], owner[second]) < 0)
    first, second = first[own], second[own]
    near = _are_near(_world_boxes(boxes, frames), boxes.half, first, second, gap)  # (N, pairs)
    finger = np.maximum(owner[first], owner[second])  # a link that no finger moves has -1, and may come after those of fingers
    return np.stack([~near[:, finger == s].any(axis=1) for s in range(len(hand.fingers))], axis=1)


def fingers_apart(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64], fingers: Sequence[int], gap: float) -> NDArray[np.bool_]:
    """Find the postures in which some fingers keep a gap from each other, from their own links and from the palm.

    Parameters
    ----------
    hand, boxes
        The hand and its boxes, from `collision_boxes`.
    frames
        (N, L, 4, 4) link frames.
    fingers
        Numbers of the fingers.
    gap
        m.

    Returns
    -------
    (N,) bool.
    """
    first, second = _pairs(hand, boxes)
    owner = hand.link_fingers[boxes.link]
    theirs = np.isin(owner, [*fingers, -1])
    own = theirs[first] & theirs[second]
    near = _are_near(_world_boxes(boxes, frames), boxes.half, first[own], second[own], gap)
    return np.asarray(~near.any(axis=1))


def choose_postures(
    hand: Hand, boxes: CollisionBoxes, *, frames: NDArray[np.float64], values: NDArray[np.float64], gap: float
) -> NDArray[np.intp]:
    """Choose one posture per finger, of greatest total value, so that all fingers keep a gap from each other.

    Parameters
    ----------
    hand, boxes
        The hand and its boxes, from `collision_boxes`.
    frames
        (O, L, 4, 4) link frames of O options, in each of which every finger has one posture; options of different fingers mix freely.
    values
        (O, F) of every finger's posture in every option; -inf for one that may not be taken.
    gap
        Least gap between boxes of different fingers, m.

    Returns
    -------
    (N, F) option taken for each finger in up to `BEAM_WIDTH` choices, best first; N is 0 when no choice keeps them apart.

    Notes
    -----
    A beam search over fingers in their order, `BEAM_WIDTH` partial choices wide.
    """
    options = len(frames)
    conflicts = finger_conflicts(hand, boxes, frames, gap)
    picks = np.empty((1, 0), np.intp)
    total = np.zeros(1)
    for finger in range(len(hand.fingers)):
        allowed = np.ones((len(picks), options), bool)
        for earlier in range(finger):
            allowed &= ~conflicts[earlier, finger][picks[:, earlier]]
        scores = np.where(allowed, total[:, None] + values[:, finger], -np.inf).ravel()
        best = np.argsort(-scores, kind="stable")[:BEAM_WIDTH]
        best = best[np.isfinite(scores[best])]
        picks = np.concatenate([picks[best // options], (best % options)[:, None]], axis=1)
        total = scores[best]
    return picks


def overlapping_neighbours(hand: Hand, boxes: CollisionBoxes) -> frozenset[tuple[int, int]]:
    """Find neighbouring links that overlap at rest: every joint at 0, or at its limit nearest to 0.

    Parameters
    ----------
    hand, boxes
        The hand and its boxes, from `collision_boxes`.

    Returns
    -------
    Pairs of links, the lower number first.
    """
    rest = forward_kinematics(hand, np.eye(4), np.clip(0.0, hand.lower, hand.upper))[None]
    return frozenset(pair for pair, gap in _link_gaps(hand, boxes, rest) if gap[0] < 0 and _are_neighbours(hand, *pair))


def frequent_overlaps(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64], gap: float = 0.0) -> list[LinkOverlap]:
    """List the pairs of links that overlap in many postures and are not allowed to, worst first.

    Parameters
    ----------
    hand, boxes
        The hand and its boxes, from `collision_boxes`.
    frames
        (N, L, 4, 4) float64 link frames of N postures, m.
    gap
        m, links nearer than this count as overlapping.

    Returns
    -------
    Pairs with the share of postures in which they overlap, and their depth.
    """
    overlaps = []
    for pair, gaps in _link_gaps(hand, boxes, frames):
        share = float((gaps < gap).mean())
        if share >= FREQUENT_SHARE and pair not in hand.allowed_contacts:
            overlaps.append(LinkOverlap(*pair, share, float(-np.median(gaps[gaps < gap]))))
    return sorted(overlaps, key=lambda overlap: (-overlap.share, overlap.first, overlap.second))


def _link_gaps(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64]) -> Iterator[tuple[tuple[int, int], NDArray[np.float64]]]:
    """Yield the pairs of links that can meet, each with its least gap (N,), m."""
    world = _world_boxes(boxes, frames)
    for first, second in np.argwhere(_meeting_links(hand)).tolist():
        a, b = (rows.ravel() for rows in np.meshgrid(np.flatnonzero(boxes.link == first), np.flatnonzero(boxes.link == second)))
        if len(a):
            yield (first, second), np.array([_least_gap(posture, boxes.half, a, b) for posture in world])


def _are_neighbours(hand: Hand, first: int, second: int) -> bool:
    """Whether at most `MAX_NEIGHBOUR_JOINTS` moving joints lead from the first link down to the second."""
    bodies = rigid_bodies(hand)
    body = bodies[second]
    for _ in range(MAX_NEIGHBOUR_JOINTS):
        if body == 0:
            return False
        body = bodies[hand.joints[body - 1].parent]  # joint i moves link i + 1
        if body == bodies[first]:
            return True
    return False


def finger_conflicts(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64], gap: float) -> NDArray[np.bool_]:
    """(F, F, O, O): finger a in option i is too near finger b in option j; filled for a < b."""
    return _conflicts(_world_boxes(boxes, frames), boxes.half, hand.link_fingers[boxes.link], len(hand.fingers), gap)


@compiled
def _are_near(world: Float64Array, half: Float64Array, first: NDArray[np.intp], second: NDArray[np.intp], gap: float) -> NDArray[np.bool_]:
    """(N, pairs) whether boxes keep less than `gap`, for boxes (N, C, 4, 4)."""
    near = np.empty((len(world), len(first)), np.bool_)
    for n in range(len(world)):
        for pair in range(len(first)):
            a, b = first[pair], second[pair]
            near[n, pair] = box_gap(world[n, a], half[a], world[n, b], half[b], gap) < gap
    return near


@compiled
def _conflicts(world: Float64Array, half: Float64Array, owner: NDArray[np.intp], fingers: int, gap: float) -> NDArray[np.bool_]:
    """(F, F, O, O): finger a in option i is too near finger b in option j; filled for a < b. World frames (O, C, 4, 4) of boxes."""
    options = len(world)
    conflicts = np.zeros((fingers, fingers, options, options), np.bool_)
    radius = np.sqrt(half[:, 0] ** 2 + half[:, 1] ** 2 + half[:, 2] ** 2)
    for k in range(len(owner)):
        for m in range(len(owner)):
            if 0 <= owner[k] < owner[m]:
                reach = radius[k] + radius[m] + gap
                found = conflicts[owner[k], owner[m]]
                for i in range(options):
                    for j in range(options):
                        if not found[i, j]:
                            a, b = world[i, k], world[j, m]
                            x, y, z = a[0, 3] - b[0, 3], a[1, 3] - b[1, 3], a[2, 3] - b[2, 3]
                            if np.sqrt(x * x + y * y + z * z) < reach:
                                found[i, j] = box_gap(a, half[k], b, half[m], gap) < gap
    return conflicts


def _meeting_links(hand: Hand) -> NDArray[np.bool_]:
    """Mark the pairs of links that can meet, (L, L), the one nearer the root first.

    Links joined by a joint touch by construction, and physics does not collide them either; links that no finger moves, or that are one
    body, never meet.
    """
    meet = np.maximum.outer(hand.link_fingers, hand.link_fingers) >= 0
    meet[[joint.parent for joint in hand.joints], [joint.child for joint in hand.joints]] = False
    bodies = rigid_bodies(hand)
    return np.triu(meet & (bodies[:, None] != bodies), 1)


@lru_cache(maxsize=16)
def _pairs(hand: Hand, boxes: CollisionBoxes) -> Pairs:
    """List the pairs of boxes whose links can meet and are not allowed to."""
    meet = _meeting_links(hand)
    for pair in hand.allowed_contacts:
        meet[pair] = False
    first, second = np.nonzero(meet[np.ix_(boxes.link, boxes.link)])
    return first, second


def _world_boxes(boxes: CollisionBoxes, frames: Float64Array) -> Float64Array:
    """(..., C, 4, 4) frames of boxes for link frames (..., L, 4, 4)."""
    return compose(frames[..., boxes.link, :, :], boxes.frames)

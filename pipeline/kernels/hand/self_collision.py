"""Collisions of a hand with itself: gaps between boxes, overlaps to allow or to report, and postures that avoid them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand

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


def box_gap(
    frames_a: NDArray[np.float64], half_a: NDArray[np.float64], frames_b: NDArray[np.float64], half_b: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the largest gap between two boxes along any of the 15 candidate axes.

    Parameters
    ----------
    frames_a, frames_b
        (..., 4, 4) poses of the boxes' centres, m.
    half_a, half_b
        (..., 3) half extents, m. All four broadcast.

    Returns
    -------
    (...) float64, m: a lower bound of the distance of boxes that are apart; of boxes that overlap, minus their least overlap.
    """
    turn_a, turn_b = frames_a[..., :3, :3], frames_b[..., :3, :3]
    offset = frames_b[..., :3, 3] - frames_a[..., :3, 3]
    half_a, half_b = (np.moveaxis(np.broadcast_to(half, offset.shape), -1, 0) for half in (half_a, half_b))  # (3, ...)
    rotation = np.einsum("...ji,...jk->ik...", turn_a, turn_b)
    size = np.abs(rotation)
    shift = np.einsum("...ji,...j->i...", turn_a, offset)  # in a's axes
    gap_a = np.abs(shift) - half_a - np.einsum("ij...,j...->i...", size, half_b)
    shift_b = np.einsum("ji...,j...->i...", rotation, shift)
    gap_b = np.abs(shift_b) - half_b - np.einsum("ij...,i...->j...", size, half_a)
    k, m = [1, 2, 0], [2, 0, 1]
    distance = np.abs(shift[m, None] * rotation[k] - shift[k, None] * rotation[m])  # (3, 3, ...) along the cross products of two axes
    extent = half_a[k, None] * size[m] + half_a[m, None] * size[k]
    extent = extent + half_b[k] * size[:, m] + half_b[m] * size[:, k]
    sine2 = 1 - rotation**2
    along = np.where(sine2 > PARALLEL_SINE2, (distance - extent) / np.sqrt(np.maximum(sine2, PARALLEL_SINE2)), -np.inf)
    return np.asarray(np.maximum(np.maximum(gap_a.max(axis=0), gap_b.max(axis=0)), along.max(axis=(0, 1))))


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
    return float(_pair_gaps(boxes, frames[None], _pairs(hand, boxes)).min(initial=np.inf))


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
    near = _pair_gaps(boxes, frames, (first, second)) < gap  # (N, pairs)
    finger = np.maximum(owner[first], owner[second])  # a link that no finger moves has -1, and may come after those of fingers
    return np.stack([~near[:, finger == s].any(axis=1) for s in range(len(hand.fingers))], axis=1)


def choose_postures(
    hand: Hand, boxes: CollisionBoxes, *, frames: NDArray[np.float64], values: NDArray[np.float64], gap: float
) -> NDArray[np.intp] | None:
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
    (F,) option taken for each finger, or None when no choice keeps them apart.

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
    return picks[0] if len(picks) else None


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
    world = compose(frames[:, boxes.link], boxes.frames)  # (N, C, 4, 4)
    for first, second in np.argwhere(_meeting_links(hand)).tolist():
        a, b = (rows.ravel() for rows in np.meshgrid(np.flatnonzero(boxes.link == first), np.flatnonzero(boxes.link == second)))
        if len(a):
            yield (first, second), box_gap(world[:, a], boxes.half[a], world[:, b], boxes.half[b]).min(axis=1)


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
    fingers, options = len(hand.fingers), len(frames)
    conflicts = np.zeros((fingers, fingers, options, options), bool)
    own = [np.flatnonzero(np.isin(boxes.link, finger.links)) for finger in hand.fingers]
    world = compose(frames[:, boxes.link], boxes.frames)  # (O, C, 4, 4)
    centres, radius = world[..., :3, 3], np.linalg.norm(boxes.half, axis=1)
    for a, b in combinations(range(fingers), 2):
        apart = np.linalg.norm(
            centres[:, own[a]][:, None, :, None] - centres[:, own[b]][None, :, None], axis=-1
        )  # (O, O, boxes of a, of b)
        i, j, k, m = np.nonzero(apart < radius[own[a]][:, None] + radius[own[b]] + gap)
        left, right = own[a][k], own[b][m]
        near = box_gap(world[i, left], boxes.half[left], world[j, right], boxes.half[right]) < gap
        conflicts[a, b][i[near], j[near]] = True
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


def _pairs(hand: Hand, boxes: CollisionBoxes) -> Pairs:
    """List the pairs of boxes whose links can meet and are not allowed to."""
    meet = _meeting_links(hand)
    for pair in hand.allowed_contacts:
        meet[pair] = False
    first, second = np.nonzero(meet[np.ix_(boxes.link, boxes.link)])
    return first, second


def _pair_gaps(boxes: CollisionBoxes, frames: NDArray[np.float64], pairs: Pairs) -> NDArray[np.float64]:
    """(N, pairs) gaps for link frames (N, L, 4, 4)."""
    world = compose(frames[:, boxes.link], boxes.frames)
    first, second = pairs
    return box_gap(world[:, first], boxes.half[first], world[:, second], boxes.half[second])

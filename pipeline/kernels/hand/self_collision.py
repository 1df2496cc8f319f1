"""Collisions of a hand with itself, and the choice of one posture per finger that avoids them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.box_gap import box_gap
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.model import Hand

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]

BEAM = 256
"""Partial choices that are carried from finger to finger."""


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
    """Number the bodies of a hand, each by its first link: links that fixed joints connect are one. (L,) integers."""
    moving = {*hand.joint_links, *(follower.link for follower in hand.followers)}
    bodies = np.arange(len(hand.links))
    for joint in hand.joints:  # parents first
        if joint.child not in moving:
            bodies[joint.child] = bodies[joint.parent]
    return bodies


def fingers_clear_of_palm(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64], gap: float) -> NDArray[np.bool_]:
    """Tell which fingers keep a gap from their own links and from those that no finger moves.

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
    own = (owner[first] == owner[second]) | (owner[first] < 0)
    near = _pair_gaps(boxes, frames, (first[own], second[own])) < gap  # (N, pairs)
    return np.stack([~near[:, owner[second[own]] == s].any(axis=1) for s in range(len(hand.fingers))], axis=1)


def choose_postures(
    hand: Hand, boxes: CollisionBoxes, *, frames: NDArray[np.float64], worth: NDArray[np.float64], gap: float
) -> NDArray[np.intp] | None:
    """Choose one posture per finger, of greatest total worth, so that all fingers keep a gap from each other.

    Parameters
    ----------
    hand, boxes
        The hand and its boxes, from `collision_boxes`.
    frames
        (O, L, 4, 4) link frames of O options, in each of which every finger has one posture; options of different fingers mix freely.
    worth
        (O, F) of every finger's posture in every option; -inf for one that may not be taken.
    gap
        Least gap between boxes of different fingers, m.

    Returns
    -------
    (F,) option taken for each finger, or None when no choice keeps them apart.

    Notes
    -----
    A beam search over fingers in their order, `BEAM` partial choices wide.
    """
    options = len(frames)
    blocked = _blocked(hand, boxes, frames, gap)
    picks = np.empty((1, 0), np.intp)
    total = np.zeros(1)
    for finger in range(len(hand.fingers)):
        allowed = np.ones((len(picks), options), bool)
        for earlier in range(finger):
            allowed &= ~blocked[earlier, finger][picks[:, earlier]]
        scores = np.where(allowed, total[:, None] + worth[:, finger], -np.inf).ravel()
        best = np.argsort(-scores, kind="stable")[:BEAM]
        best = best[np.isfinite(scores[best])]
        picks = np.concatenate([picks[best // options], (best % options)[:, None]], axis=1)
        total = scores[best]
    return picks[0] if len(picks) else None


def _blocked(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64], gap: float) -> NDArray[np.bool_]:
    """(F, F, O, O): finger a in option i is too near finger b in option j; filled for a < b."""
    fingers, options = len(hand.fingers), len(frames)
    blocked = np.zeros((fingers, fingers, options, options), bool)
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
        blocked[a, b][i[near], j[near]] = True
    return blocked


def _pairs(hand: Hand, boxes: CollisionBoxes) -> Pairs:
    """Boxes that could meet, the one nearer the root first. Links joined by a joint touch by construction, and physics does not collide
    them either; nor do links that no finger moves, or that are one body, ever meet."""
    meet = np.maximum.outer(hand.link_fingers, hand.link_fingers) >= 0  # (L, L)
    meet[[joint.parent for joint in hand.joints], [joint.child for joint in hand.joints]] = False
    bodies = rigid_bodies(hand)
    meet[bodies[:, None] == bodies] = False
    for pair in hand.allowed_contacts:
        meet[pair] = False
    first, second = np.nonzero(np.triu(meet, 1)[np.ix_(boxes.link, boxes.link)])
    return first, second


def _pair_gaps(boxes: CollisionBoxes, frames: NDArray[np.float64], pairs: Pairs) -> NDArray[np.float64]:
    """(N, pairs) gaps for link frames (N, L, 4, 4)."""
    world = compose(frames[:, boxes.link], boxes.frames)
    first, second = pairs
    return box_gap(world[:, first], boxes.half[first], world[:, second], boxes.half[second])

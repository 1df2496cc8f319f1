"""Collisions of a hand with itself: gaps between its links, postures that keep them, and links that overlap or lie close together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pipeline.kernels.arrays import Array, Indices, Mask
from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.box_gaps import are_near, conflicts, least_gap
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand

Pairs = tuple[Indices, Indices]

BEAM_WIDTH = 256  # partial choices that are kept from finger to finger
MAX_NEIGHBOUR_JOINTS = 2  # moving joints between a link and a descendant that count as neighbours: a knuckle has two
FREQUENT_SHARE = 0.5  # share of the postures in which a pair must overlap to be reported


def hand_gap(hand: Hand, boxes: CollisionBoxes, frames: Array) -> float:
    """Compute the least `box_gap` between links that can meet and are not allowed to, from their frames (L, 4, 4); inf for none."""
    return least_gap(world_boxes(boxes, frames), boxes.half, *_pairs(hand, boxes))


def fingers_clear_of_palm(hand: Hand, boxes: CollisionBoxes, frames: Array, gap: float) -> Mask:  # (N, F)
    """Find the fingers that keep a gap from their own links and from those that no finger moves, by link frames (N, L, 4, 4), m."""
    first, second = _pairs(hand, boxes)
    owner = hand.link_fingers[boxes.link]
    checked = (owner[first] == owner[second]) | (np.minimum(owner[first], owner[second]) < 0)
    first, second = first[checked], second[checked]
    too_near = are_near(world_boxes(boxes, frames), boxes.half, first, second, gap)  # (N, pairs)
    finger = np.maximum(owner[first], owner[second])  # a link that no finger moves has -1, and may come after those of fingers
    return np.stack([~too_near[:, finger == s].any(axis=1) for s in range(len(hand.fingers))], axis=1)


def fingers_apart(hand: Hand, boxes: CollisionBoxes, frames: Array, fingers: Sequence[int], gap: float) -> Mask:  # (N,)
    """Find the postures, by link frames (N, L, 4, 4), in which some fingers keep a gap from each other, own links and palm."""
    first, second = _pairs(hand, boxes)
    owner = hand.link_fingers[boxes.link]
    involved = np.isin(owner, [*fingers, -1])
    checked = involved[first] & involved[second]
    too_near = are_near(world_boxes(boxes, frames), boxes.half, first[checked], second[checked], gap)
    return np.asarray(~too_near.any(axis=1))


def choose_postures(
    hand: Hand,
    boxes: CollisionBoxes,
    *,
    frames: Array,  # (O, L, 4, 4) link frames of O options, in each of which every finger has one posture
    values: Array,  # (O, F) of every finger's posture in every option; -inf for one that may not be taken
    gap: float,  # m, least gap between boxes of different fingers
) -> Indices:  # (N, F) option taken for each finger, best choice first; N is 0 when none keeps them apart
    """Choose one posture per finger, of greatest total value, so that all fingers keep a gap from each other.

    Options of different fingers mix freely: a beam search over fingers in their order, `BEAM_WIDTH` partial choices wide.
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


def finger_conflicts(hand: Hand, boxes: CollisionBoxes, frames: Array, gap: float) -> Mask:
    """Find where finger a in option i is too near finger b in option j, (F, F, O, O); filled for a < b."""
    owner = hand.link_fingers[boxes.link]
    return conflicts(world_boxes(boxes, frames), boxes.half, *_pairs(hand, boxes), owner, len(hand.fingers), gap)


def rigid_bodies(hand: Hand) -> Indices:
    """Compute the body of each link, (L,), numbered by the body's first link: fixed joints connect links to one body."""
    moving = {*hand.joint_links, *(follower.link for follower in hand.followers)}
    bodies = np.arange(len(hand.links))
    for joint in hand.joints:  # parents first
        if joint.child not in moving:
            bodies[joint.child] = bodies[joint.parent]
    return bodies


def meeting_links(hand: Hand) -> Mask:
    """Mark the pairs of links that can meet, (L, L), the one nearer the root first.

    Links that a joint joins touch by construction; links that no finger moves, or that are one body, never meet.
    """
    meet = np.maximum.outer(hand.link_fingers, hand.link_fingers) >= 0
    meet[[joint.parent for joint in hand.joints], [joint.child for joint in hand.joints]] = False
    bodies = rigid_bodies(hand)
    return np.triu(meet & (bodies[:, None] != bodies), 1)


@lru_cache(maxsize=16)
def _pairs(hand: Hand, boxes: CollisionBoxes) -> Pairs:
    """List the pairs of boxes whose links can meet and are not allowed to."""
    meet = meeting_links(hand)
    for pair in hand.allowed_contacts:
        meet[pair] = False
    first, second = np.nonzero(meet[np.ix_(boxes.link, boxes.link)])
    return first, second


def world_boxes(boxes: CollisionBoxes, frames: Array) -> Array:
    """Compute the frames of boxes, (..., C, 4, 4), from link frames (..., L, 4, 4)."""
    return compose(frames[..., boxes.link, :, :], boxes.frames)


@dataclass(frozen=True)
class LinkOverlap:
    """Two links whose boxes overlap in many postures."""

    first: int
    second: int
    share: float  # of the postures
    depth: float  # m, median; a negative depth is a gap


def overlapping_neighbours(hand: Hand, boxes: CollisionBoxes) -> frozenset[tuple[int, int]]:
    """Find neighbours, lower number first, that overlap at rest: every joint at 0, or at its limit nearest to 0."""
    return frozenset(pair for pair, gap in _resting_gaps(hand, boxes) if gap < 0 and _are_neighbours(hand, *pair))


def close_links(hand: Hand, boxes: CollisionBoxes, within: float) -> dict[tuple[int, int], float]:
    """Compute the gaps at rest, m, of links that are nearer than `within` and not allowed to touch; the one nearer the root first."""
    return {pair: gap for pair, gap in _resting_gaps(hand, boxes) if gap < within and pair not in hand.allowed_contacts}


def frequent_overlaps(hand: Hand, boxes: CollisionBoxes, frames: Array, gap: float = 0.0) -> list[LinkOverlap]:
    """List the pairs of links nearer than `gap` in many postures (N, L, 4, 4) that are not allowed to touch, worst first."""
    overlaps = []
    for pair, gaps in _link_gaps(hand, boxes, frames):
        share = float((gaps < gap).mean())
        if share >= FREQUENT_SHARE and pair not in hand.allowed_contacts:
            overlaps.append(LinkOverlap(*pair, share, float(-np.median(gaps[gaps < gap]))))
    return sorted(overlaps, key=lambda overlap: (-overlap.share, overlap.first, overlap.second))


def remedy(hand: Hand, overlap: LinkOverlap) -> str:
    """Name the entry of the hand file that ends an overlap.

    It is `convex_parts` of links whose mesh is one convex shape, which fills its hollows; if there are none, `allowed_contacts`.
    """
    links = [hand.links[overlap.first], hand.links[overlap.second]]
    entries = [f"{link.name}: 8" for link in links if sum(shape.kind == "mesh" for shape in link.collisions) == 1]
    return f"`convex_parts: {{{', '.join(entries)}}}`" if entries else f"`allowed_contacts: [[{links[0].name}, {links[1].name}]]`"


def _resting_gaps(hand: Hand, boxes: CollisionBoxes) -> Iterator[tuple[tuple[int, int], float]]:
    """Yield the pairs of links that can meet, each with its gap at rest, m."""
    resting_frames = forward_kinematics(hand, np.eye(4), np.clip(0.0, hand.lower, hand.upper))[None]
    return ((pair, float(gap[0])) for pair, gap in _link_gaps(hand, boxes, resting_frames))


def _link_gaps(hand: Hand, boxes: CollisionBoxes, frames: Array) -> Iterator[tuple[tuple[int, int], Array]]:
    """Yield the pairs of links that can meet, each with its least gap (N,), m."""
    world = world_boxes(boxes, frames)
    for first, second in np.argwhere(meeting_links(hand)).tolist():
        a, b = (rows.ravel() for rows in np.meshgrid(np.flatnonzero(boxes.link == first), np.flatnonzero(boxes.link == second)))
        if len(a):
            yield (first, second), np.array([least_gap(posture, boxes.half, a, b) for posture in world])


def _are_neighbours(hand: Hand, first: int, second: int) -> bool:
    """Check whether at most `MAX_NEIGHBOUR_JOINTS` moving joints lead from the first link down to the second."""
    bodies = rigid_bodies(hand)
    body = bodies[second]
    for _ in range(MAX_NEIGHBOUR_JOINTS):
        if body == 0:
            return False
        body = bodies[hand.joints[body - 1].parent]  # joint i moves link i + 1
        if body == bodies[first]:
            return True
    return False

"""Links of a hand that overlap, at rest or in many postures, and those that lie close side by side."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.hand.box_gaps import least_gap
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import meeting_links, rigid_bodies, world_boxes

MAX_NEIGHBOUR_JOINTS = 2
"""Most moving joints between a link and its descendant that still count as neighbours: a knuckle has two."""
FREQUENT_SHARE = 0.5  # share of the postures in which a pair must overlap to be reported


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
    """Find links that lie close side by side at rest, as those of two fingers may.

    Each pair that is nearer than `within` and not allowed to touch has its gap, m; the link nearer the root comes
    first.
    """
    return {pair: gap for pair, gap in _resting_gaps(hand, boxes) if gap < within and pair not in hand.allowed_contacts}


def frequent_overlaps(
    hand: Hand,
    boxes: CollisionBoxes,
    frames: Array,  # (N, L, 4, 4) link frames of N postures, m
    gap: float = 0.0,  # m, links nearer than this count as overlapping
) -> list[LinkOverlap]:
    """List the pairs of links that overlap in many postures and are not allowed to, worst first."""
    overlaps = []
    for pair, gaps in _link_gaps(hand, boxes, frames):
        share = float((gaps < gap).mean())
        if share >= FREQUENT_SHARE and pair not in hand.allowed_contacts:
            overlaps.append(LinkOverlap(*pair, share, float(-np.median(gaps[gaps < gap]))))
    return sorted(overlaps, key=lambda overlap: (-overlap.share, overlap.first, overlap.second))


def remedy(hand: Hand, overlap: LinkOverlap) -> str:
    """Name the entry of the hand file that ends an overlap.

    It is `convex_parts` of links whose mesh is taken as one convex shape, which fills its hollows; if there are none,
    `allowed_contacts`.
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

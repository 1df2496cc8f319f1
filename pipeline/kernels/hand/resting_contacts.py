"""Links of a hand that overlap in most postures: neighbours that overlap at rest are let be, others are named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.box_gap import box_gap
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import rigid_bodies

NEIGHBOURS = 2
"""Moving joints at most between a link and one that hangs from it, for them to count as neighbours: a knuckle has two."""

OFTEN = 0.5
"""Share of the postures in which a pair overlaps that is worth naming."""


@dataclass(frozen=True)
class Overlap:
    """Two links whose boxes overlap in a share of postures, by `depth` m in the median of those."""

    first: int
    second: int
    share: float
    depth: float


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
    return frozenset(pair for pair, gap in _gaps(hand, boxes, rest) if gap[0] < 0 and _are_neighbours(hand, *pair))


def frequent_overlaps(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64]) -> list[Overlap]:
    """List the pairs of links that overlap in many postures and are not allowed to, worst first.

    Parameters
    ----------
    hand, boxes
        The hand and its boxes, from `collision_boxes`.
    frames
        (N, L, 4, 4) float64 link frames of N postures, m.
    """
    found = []
    for pair, gap in _gaps(hand, boxes, frames):
        share = float((gap < 0).mean())
        if share >= OFTEN and pair not in hand.allowed_contacts:
            found.append(Overlap(*pair, share, float(-np.median(gap[gap < 0]))))
    return sorted(found, key=lambda overlap: (-overlap.share, overlap.first, overlap.second))


def _gaps(hand: Hand, boxes: CollisionBoxes, frames: NDArray[np.float64]) -> Iterator[tuple[tuple[int, int], NDArray[np.float64]]]:
    """The least gap (N,) of every two links that are joined by no joint, and of which a finger moves one."""
    world = compose(frames[:, boxes.link], boxes.frames)  # (N, C, 4, 4)
    bodies, fingers = rigid_bodies(hand), hand.link_fingers
    joined = {(joint.parent, joint.child) for joint in hand.joints}
    own = {link: np.flatnonzero(boxes.link == link) for link in set(boxes.link.tolist())}
    for first in own:
        for second in own:
            if first >= second or bodies[first] == bodies[second] or (first, second) in joined or max(fingers[[first, second]]) < 0:
                continue
            a, b = (rows.ravel() for rows in np.meshgrid(own[first], own[second]))
            yield (first, second), box_gap(world[:, a], boxes.half[a], world[:, b], boxes.half[b]).min(axis=1)


def _are_neighbours(hand: Hand, first: int, second: int) -> bool:
    """Whether the second link hangs from the first, with `NEIGHBOURS` moving joints between at most; fingers side by side do not."""
    bodies = rigid_bodies(hand)
    body = bodies[second]
    for _ in range(NEIGHBOURS):
        if body == 0:
            return False
        body = bodies[hand.joints[body - 1].parent]  # joint i moves link i + 1
        if body == bodies[first]:
            return True
    return False

"""Collisions of a hand with itself: gaps between the boxes of its links, postures that keep them, and links that overlap."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pipeline.kernels.arrays import Array, Indices, Mask
from pipeline.kernels.compiled import compiled, for_few
from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.collision_shapes import CollisionBoxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand

PARALLEL_SINE2 = 1e-6  # squared sine below which edges are parallel: their cross product is no axis, those of faces do
Pairs = tuple[Indices, Indices]

BEAM_WIDTH = 256  # partial choices that are kept from finger to finger
MAX_NEIGHBOUR_JOINTS = 2  # moving joints between a link and a descendant that count as neighbours: a knuckle has two
FREQUENT_SHARE = 0.5  # share of the postures in which a pair must overlap to be reported


@compiled
def box_gap(
    frame_a: Array,  # (4, 4) pose of the box's centre, m
    half_a: Array,  # (3,) half extents, m
    frame_b: Array,
    half_b: Array,
    enough: float = np.inf,  # m, a gap as good as any larger one: the search ends there
) -> float:  # m; a lower bound of the distance of boxes that are apart; of boxes that overlap, minus their least overlap
    """Compute the largest gap between two boxes along any of the 15 candidate axes."""
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


@compiled
def box_gaps(
    world: Array,  # (N, C, 4, 4) frames of boxes
    half: Array,  # (C, 3) half extents
    first: Indices,  # (pairs,)
    second: Indices,
    enough: float = np.inf,  # as for `box_gap`
) -> Array:  # (N, pairs) m
    """Compute the gap of every pair of boxes in every posture."""
    gaps = np.empty((len(world), len(first)))
    for n in range(len(world)):
        for pair in range(len(first)):
            a, b = first[pair], second[pair]
            gaps[n, pair] = box_gap(world[n, a], half[a], world[n, b], half[b], enough)
    return gaps


@compiled
def box_conflicts(
    world: Array,  # (O, C, 4, 4) frames of boxes
    half: Array,  # (C, 3) half extents
    first: Indices,  # (pairs,) of boxes that may not touch
    second: Indices,
    owner: Indices,  # (C,) finger of each box, -1 for none
    fingers: int,
    gap: float,
) -> Mask:  # (F, F, O, O)
    """Find where finger a in option i is too near finger b in option j; filled for a < b."""
    options = len(world)
    conflicts = np.zeros((fingers, fingers, options, options), np.bool_)
    radius = np.sqrt(half[:, 0] ** 2 + half[:, 1] ** 2 + half[:, 2] ** 2)
    for pair in range(len(first)):
        k, m = first[pair], second[pair]
        if owner[k] > owner[m]:
            k, m = m, k
        if owner[k] < 0 or owner[k] == owner[m]:
            continue
        reach = radius[k] + radius[m] + gap
        pair_conflicts = conflicts[owner[k], owner[m]]
        for i in range(options):
            for j in range(options):
                if not pair_conflicts[i, j]:
                    a, b = world[i, k], world[j, m]
                    x, y, z = a[0, 3] - b[0, 3], a[1, 3] - b[1, 3], a[2, 3] - b[2, 3]
                    if np.sqrt(x * x + y * y + z * z) < reach:
                        pair_conflicts[i, j] = box_gap(a, half[k], b, half[m], gap) < gap
    return conflicts


def hand_gap(hand: Hand, boxes: CollisionBoxes, frames: Array) -> float:
    """Compute the least `box_gap` between links that can meet and are not allowed to, from their frames (L, 4, 4); inf for none."""
    return float(box_gaps(world_boxes(boxes, frames[None]), boxes.half, *_pairs(hand, boxes)).min(initial=np.inf))


def fingers_clear_of_palm(hand: Hand, boxes: CollisionBoxes, frames: Array, gap: float) -> Mask:  # (N, F)
    """Find the fingers that keep a gap from their own links and from those that no finger moves, by link frames (N, L, 4, 4), m."""
    return np.stack([fingers_apart(hand, boxes, frames, [finger], gap) for finger in range(len(hand.fingers))], axis=1)


def fingers_apart(hand: Hand, boxes: CollisionBoxes, frames: Array, fingers: Sequence[int], gap: float) -> Mask:  # (N,)
    """Find the postures, by link frames (N, L, 4, 4), in which some fingers keep a gap from each other, own links and palm."""
    first, second = _pairs(hand, boxes)
    owner = hand.link_fingers[boxes.link]
    involved = np.isin(owner, [*fingers, -1])
    checked = involved[first] & involved[second]
    gaps = box_gaps(world_boxes(boxes, frames), boxes.half, first[checked], second[checked], gap)
    return np.asarray((gaps >= gap).all(axis=1))


def choose_postures(
    hand: Hand,
    boxes: CollisionBoxes,
    *,
    frames: Array,  # (O, L, 4, 4) link frames of O options, in each of which every finger has one posture
    values: Array,  # (O, F) of every finger's posture in every option; -inf for one that may not be taken
    gap: float,  # m, least gap between boxes of different fingers
) -> Indices:  # (N, F) option taken for each finger, best choice first; N is 0 when none keeps them apart
    """Choose one posture per finger, of greatest total value, so that all fingers keep a gap: a beam search over fingers."""
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
    return box_conflicts(world_boxes(boxes, frames), boxes.half, *_pairs(hand, boxes), owner, len(hand.fingers), gap)


def rigid_bodies(hand: Hand) -> Indices:
    """Compute the body of each link, (L,), numbered by the body's first link: fixed joints connect links to one body."""
    moving = {*hand.joint_links, *(follower.link for follower in hand.followers)}
    bodies = np.arange(len(hand.links))
    for joint in hand.joints:  # parents first
        if joint.child not in moving:
            bodies[joint.child] = bodies[joint.parent]
    return bodies


def meeting_links(hand: Hand) -> Mask:
    """Mark the pairs of links that can meet, (L, L), the one nearer the root first: not neighbours, one body, or all without finger."""
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


def remedy(hand: Hand, overlaps: Iterable[LinkOverlap]) -> str:
    """Name the entries of the hand file that end overlaps: `convex_parts` of links of one mesh, whose hollows it fills, if any."""
    parts, contacts = dict[str, None](), list[str]()
    for overlap in overlaps:
        links = [hand.links[overlap.first], hand.links[overlap.second]]
        hollow = [f"{link.name}: 8" for link in links if sum(shape.kind == "mesh" for shape in link.collisions) == 1]
        parts |= dict.fromkeys(hollow)
        contacts += [] if hollow else [f"[{links[0].name}, {links[1].name}]"]
    entries = [f"`convex_parts: {{{', '.join(parts)}}}`"] if parts else []
    return " and ".join([*entries, *([f"`allowed_contacts: [{', '.join(contacts)}]`"] if contacts else [])])


def _resting_gaps(hand: Hand, boxes: CollisionBoxes) -> Iterator[tuple[tuple[int, int], float]]:
    """Yield the pairs of links that can meet, each with its gap at rest, m."""
    resting_frames = forward_kinematics(hand, np.eye(4), np.clip(0.0, hand.lower, hand.upper))[None]
    return ((pair, float(gap[0])) for pair, gap in _link_gaps(hand, boxes, resting_frames))


def _link_gaps(hand: Hand, boxes: CollisionBoxes, frames: Array) -> Iterator[tuple[tuple[int, int], Array]]:
    """Yield the pairs of links that can meet, each with its least gap (N,), m."""
    world, gaps_of = world_boxes(boxes, frames), for_few(box_gaps) if len(frames) == 1 else box_gaps
    for first, second in np.argwhere(meeting_links(hand)).tolist():
        a, b = (rows.ravel() for rows in np.meshgrid(np.flatnonzero(boxes.link == first), np.flatnonzero(boxes.link == second)))
        if len(a):
            yield (first, second), gaps_of(world, boxes.half, a, b).min(axis=1)


def _are_neighbours(hand: Hand, first: int, second: int) -> bool:
    """Check whether at most `MAX_NEIGHBOUR_JOINTS` moving joints lead from the first link down to the second."""
    bodies = rigid_bodies(hand)
    body = bodies[second]
    for _ in range(MAX_NEIGHBOUR_JOINTS):
        body = bodies[hand.joints[body - 1].parent] if body > 0 else -1  # joint i moves link i + 1
        if body == bodies[first]:
            return True
    return False

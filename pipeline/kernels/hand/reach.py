"""What one look at a hand posture tells: how far every gel reaches into the object, and how far every finger keeps clear of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.bodies import Balls
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.hand.model import Hand

PROBE_DEPTH = 0.6
"""Height above the sensor plane, in gel thicknesses, to which a surface should press in: a firm touch, far from the rigid face."""
PROBES = 4
"""Probe points along a side of the gel: 4 mm apart on a 16 mm gel."""


@dataclass(frozen=True, eq=False)
class FingerParts:
    """What a look at a posture takes, prepared once a hand.

    Attributes
    ----------
    tips, others
        Balls of each finger's tip link, which is most in the way, and of the other links that it moves.
    probes
        (S, PROBES², 3) points in the gel at `PROBE_DEPTH`, in the frame of the finger's tip link, m.
    """

    tips: tuple[Balls, ...]
    others: tuple[Balls, ...]
    probes: NDArray[np.float64]


def finger_parts(hand: Hand, balls: Balls, width: float, thickness: float) -> FingerParts:
    """Sort `balls` by finger and lay probes into gels of the given width and thickness, m."""
    bodiless = [finger.name for finger in hand.fingers if not len(balls.of(finger.links).radii)]
    if bodiless:
        raise InvalidInput(
            f"{hand.urdf}: no link of {', '.join(bodiless)} has a collision shape; a finger needs one not to reach through things"
        )
    tips = tuple(balls.of([finger.tip]) for finger in hand.fingers)
    others = tuple(balls.of([link for link in finger.links if link != finger.tip]) for finger in hand.fingers)
    steps = ((np.arange(PROBES) + 0.5) / PROBES - 0.5) * width
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    points = np.stack([x, y, np.full_like(x, PROBE_DEPTH * thickness)], axis=-1)
    probes = np.stack([transform_points(finger.sensor_pose, points) for finger in hand.fingers])
    return FingerParts(tips, others, probes)


def gel_probes(hand: Hand, parts: FingerParts, frames: NDArray[np.float64]) -> NDArray[np.float32]:
    """(3, N, S, PROBES²) probe points of postures whose link frames are (N, L, 4, 4)."""
    tips = frames[:, [finger.tip for finger in hand.fingers]]  # (N, S, 4, 4)
    turned = np.einsum("nsij,spj->insp", tips[..., :3, :3], parts.probes)
    points: NDArray[np.float32] = (turned + np.moveaxis(tips[..., :3, 3], -1, 0)[..., None]).astype(np.float32)
    return points


def gel_contact(field: DistanceField, probes: NDArray[np.float32], reach: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Contact and coverage (N, S) of probe points (3, N, S, P); a probe counts for coverage within `reach` of the object, m."""
    distance = field.lookup(probes)
    return distance.min(axis=-1), (distance < reach).mean(axis=-1, dtype=np.float32)


def finger_clearance(field: DistanceField, parts: FingerParts, frames: NDArray[np.float64]) -> NDArray[np.float32]:
    """(N, S) least distance of every finger's rigid parts from the object, m, negative inside; frames (N, L, 4, 4)."""
    return np.minimum(clearance_of(parts.tips, field, frames), clearance_of(parts.others, field, frames))


def clearance_of(
    balls: Sequence[Balls], field: DistanceField, frames: NDArray[np.float64], asked: NDArray[np.bool_] | None = None
) -> NDArray[np.float32]:
    """(N, S) least distance of each finger's `balls` from the object, m; of those `asked` for, (N, S), +inf elsewhere; else of all."""
    single = frames.astype(np.float32)
    clearance = np.full((len(frames), len(balls)), np.inf, np.float32)
    for s, own in enumerate(balls):
        rows = np.arange(len(frames)) if asked is None else np.flatnonzero(asked[:, s])
        if len(rows) and len(own.radii):
            distance = field.lookup(ball_points(own, single[rows])) - own.radii.astype(np.float32)
            clearance[rows, s] = distance.min(axis=1)
    return clearance


def ball_points(balls: Balls, frames: NDArray[Any]) -> NDArray[Any]:
    """(3, N, B) centres of balls carried by link frames (N, L, 4, 4), in the frames' precision: 2^-22 of the largest coordinate in
    float32, 0.2 µm a metre from the origin."""
    points = np.empty((3, len(frames), len(balls.link)), frames.dtype)
    centres = np.concatenate([balls.centres.T, np.ones((1, len(balls.link)))]).astype(frames.dtype)
    edges = np.flatnonzero(np.diff(balls.link, prepend=-1, append=-1))
    for first, last in pairwise(edges):
        points[:, :, first:last] = np.einsum("nij,jb->inb", frames[:, balls.link[first], :3], centres[:, first:last])
    return points

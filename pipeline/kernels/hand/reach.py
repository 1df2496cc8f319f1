"""What one look at a hand posture tells: how far every gel reaches into the object, and how far every finger keeps clear of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.hand.bodies import Balls
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.hand.model import Hand

PROBE_DEPTH = 0.6
"""Height above the sensor plane, in gel thicknesses, to which a surface should press in: a firm touch, far from the rigid face."""
PROBES = 4
"""Probe points along a side of the gel: 4 mm apart on a 16 mm gel."""


@dataclass(frozen=True, eq=False)
class FingerParts:
    """What `judge` looks at, prepared once a hand.

    Attributes
    ----------
    balls
        Of all links that a finger moves, finger by finger.
    starts
        (S,) first ball of every finger.
    probes
        (S, PROBES², 3) points in the gel at `PROBE_DEPTH`, in the frame of the finger's tip link, m.
    """

    balls: Balls
    starts: NDArray[np.intp]
    probes: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Judgement:
    """(..., S) each: `contact`, the least signed distance of a gel's probes from the object (negative: it presses in as far as wanted),
    `coverage`, the share of its probes inside or at the object, `clearance`, of the finger's rigid parts; m."""

    contact: NDArray[np.float32]
    coverage: NDArray[np.float32]
    clearance: NDArray[np.float32]


def finger_parts(hand: Hand, balls: Balls, width: float, thickness: float) -> FingerParts:
    """Sort `balls` by finger and lay probes into gels of the given width and thickness, m."""
    own = [balls.of(finger.links) for finger in hand.fingers]
    bodiless = [finger.name for finger, part in zip(hand.fingers, own, strict=True) if not len(part.radii)]
    if bodiless:
        raise ValueError(
            f"{hand.urdf}: no link of {', '.join(bodiless)} has a collision shape; a finger needs one not to reach through things"
        )
    joined = Balls(*(np.concatenate([getattr(part, name) for part in own]) for name in ("centres", "radii", "link")))
    starts = np.cumsum([0, *(len(part.radii) for part in own)])[:-1]
    steps = ((np.arange(PROBES) + 0.5) / PROBES - 0.5) * width
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    points = np.stack([x, y, np.full_like(x, PROBE_DEPTH * thickness), np.ones_like(x)])
    probes = np.stack([(finger.sensor_pose @ points)[:3].T for finger in hand.fingers])
    return FingerParts(joined, starts, probes)


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
    distance = field.lookup(ball_points(parts.balls, frames.astype(np.float32))) - parts.balls.radii.astype(np.float32)
    return np.minimum.reduceat(distance, parts.starts, axis=1)


def ball_points(balls: Balls, frames: NDArray[Any]) -> NDArray[Any]:
    """(3, N, B) centres of balls carried by link frames (N, L, 4, 4), in the frames' precision."""
    points = np.empty((3, len(frames), len(balls.link)), frames.dtype)
    centres = np.concatenate([balls.centres.T, np.ones((1, len(balls.link)))]).astype(frames.dtype)
    edges = np.flatnonzero(np.diff(balls.link, prepend=-1, append=-1))
    for first, last in pairwise(edges):
        points[:, :, first:last] = np.moveaxis(frames[:, balls.link[first], :3] @ centres[:, first:last], 1, 0)
    return points


def judge(hand: Hand, parts: FingerParts, field: DistanceField, frames: NDArray[np.float64], reach: float) -> Judgement:
    """Contact, coverage and clearance of every finger in postures whose link frames in the world are (N, L, 4, 4)."""
    contact, coverage = gel_contact(field, gel_probes(hand, parts, frames), reach)
    return Judgement(contact, coverage, finger_clearance(field, parts, frames))

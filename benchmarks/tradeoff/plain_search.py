"""The inverse kinematics' search without its bounds: every posture of every finger is measured whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.hand import inverse
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.hand.kinematics import forward
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.reach import FingerParts, finger_clearance

Angles = NDArray[np.float64]
Mask = NDArray[np.bool_]


@contextmanager
def measuring_all() -> Iterator[None]:
    """`inverse.solve` and `inverse.has_room` without bounds, for as long as the context lasts."""
    with patch.multiple(inverse, _from_samples=from_samples, _refine=refine), patch.object(inverse, "clearance_of", _no_other_look):
        yield


def has_room(hand: Hand, parts: FingerParts, samples: inverse.PostureSamples, field: DistanceField, pose: Angles, clearance: float) -> bool:
    rows = np.linspace(0, len(samples.joint_angles) - 1, inverse.SPREAD).astype(np.intp)
    clear = finger_clearance(field, parts, pose @ samples.frames[rows]) >= clearance
    return bool((clear & samples.free[rows]).any(axis=0).all())


def from_samples(
    hand: Hand, parts: FingerParts, samples: inverse.PostureSamples, field: DistanceField, pose: Angles, wanted: inverse.Wanted
) -> tuple[Angles, Angles, Mask]:
    rows = inverse.looked_at(samples, field, pose, wanted)
    angles, frames = inverse._mix(hand, samples, rows, pose)
    value, clearance = _measured(hand, parts, field, frames, wanted)
    value = np.where(np.take_along_axis(samples.free, rows, axis=0), value, -np.inf)
    calm = np.where(clearance >= wanted.clearance, value, -np.inf)
    best = inverse._best(hand, angles, value, inverse.LINES), inverse._best(hand, angles, calm, inverse.AT_REST)
    return *best, np.ones(value.shape, bool)


def refine(
    hand: Hand,
    parts: FingerParts,
    field: DistanceField,
    pose: Angles,
    wanted: inverse.Wanted,
    lines: Angles,
    step: float,
    rng: np.random.Generator,
) -> tuple[Angles, Mask]:
    children = lines[:, None] + step * rng.standard_normal((len(lines), inverse.NEIGHBOURS + 1, lines.shape[1]))
    children[:, 0] = lines
    children = np.clip(children, hand.lower + inverse.LIMIT_MARGIN, hand.upper - inverse.LIMIT_MARGIN)
    frames = forward(hand, pose, children.reshape(-1, lines.shape[1]))
    value = _measured(hand, parts, field, frames, wanted)[0].reshape(*children.shape[:2], -1)
    best = value.argmax(axis=1)  # (LINES, S)
    refined = lines.copy()
    for s, finger in enumerate(hand.fingers):
        joints = list(finger.joints)
        refined[:, joints] = children[np.arange(len(lines)), best[:, s]][:, joints]
    return refined, np.ones(value.shape, bool)


def _measured(
    hand: Hand, parts: FingerParts, field: DistanceField, frames: Angles, wanted: inverse.Wanted
) -> tuple[Angles, NDArray[np.float32]]:
    clearance = finger_clearance(field, parts, frames)
    return inverse._value(inverse._bound(hand, parts, field, frames, wanted), clearance, wanted), clearance


def _no_other_look(*_: object) -> NDArray[np.float32]:
    raise AssertionError("the plain search looks at whole fingers only")

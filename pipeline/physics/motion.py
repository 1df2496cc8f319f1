"""How an object that was freed in a grasp moves, and how a hand closes on it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import length

RESTING_LOOKS, RESTING_CHANGE = 12, 1e-3
"""An object rests when its pose, m and quaternion, changes by less in so many looks, a quarter of a second; what slides accelerates.
Of 50 grasps of ten objects, the rest of the second moves none by 0.1 mm."""
CLOSING_STAGES, CLOSING_SECONDS = 10, 0.4
"""Targets that the motors are given from one posture to the next where a hand closes, and the time that takes, as in DexGraspBench."""


@dataclass(frozen=True)
class Motion:
    """How far an object that was freed in a grasp has moved in the end.

    Attributes
    ----------
    moved, turned
        Way of the object's centre, m, and angle of its turn, rad; infinite where the engine's numbers overflow.
    penetration
        How deep the hand was in the object at the start, by the engine's shapes, m: in PyBullet's surface, only what crosses it counts.
    """

    moved: float
    turned: float
    penetration: float = 0.0


class Track:
    """The poses of an object that was freed, looked at every 0.02 s: (7,) its centre, m, and the quaternion of its turn."""

    def __init__(self, start: NDArray[np.float64], *, limit: float) -> None:
        self.poses, self.limit = [start], limit

    def ends(self, pose: NDArray[np.float64]) -> bool:
        """Add a pose, and tell whether the object is beyond the limit, or rests."""
        self.poses.append(pose)
        if not length(pose[:3] - self.poses[0][:3]) <= self.limit:  # where it is not a number, either
            return True
        before = self.poses[-1 - RESTING_LOOKS] if len(self.poses) > RESTING_LOOKS else np.inf
        return bool(np.abs(pose - before).max() < RESTING_CHANGE)

    def motion(self, penetration: float) -> Motion:
        """Compare the last pose with the first."""
        first, last = self.poses[0], self.poses[-1]
        if not np.isfinite(last).all():
            return Motion(np.inf, np.inf, penetration)
        apart = min(float(length(last[3:] - first[3:])), float(length(last[3:] + first[3:])))  # of unit quaternions, which have two signs
        return Motion(float(length(last[:3] - first[:3])), 4 * float(np.arcsin(min(apart / 2, 1.0))), penetration)


def closing_path(*postures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate linearly between postures (J,), rad; (stages, J), without the first."""
    return np.concatenate([np.linspace(a, b, CLOSING_STAGES + 1)[1:] for a, b in pairwise(postures)])

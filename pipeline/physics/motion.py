"""How an object that was freed in a grasp and the hand move, and how the hand closes on it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.kernels.geometry.transforms import length

RESTING_LOOKS, RESTING_CHANGE = 12, 1e-3
"""An object rests when its pose, m and quaternion, changes by less in so many looks, a quarter of a second; what slides accelerates.
Of 50 grasps of ten objects, the rest of the second moves none by 0.1 mm."""
SAFETY, SURE_TURN = 5, 0.05
"""An object that creeps is sure to stay where so many times what it would move on in the remaining time, at the speed of the last quarter
of a second, leaves it within the limit, and turns it by less, as a change of a quaternion (6°): then the rest is not simulated."""
CLOSING_STAGES, CLOSING_SECONDS = 10, 0.4
"""Targets that the motors are given from one posture to the next where a hand closes, and the time that takes, as in DexGraspBench."""


@dataclass(frozen=True, eq=False)
class Motion:
    """How an object that was freed in a grasp and the hand have moved.

    Attributes
    ----------
    moved, turned
        Way of the object's centre, m, and angle of its turn, rad, in the end; infinite where the engine's numbers overflow.
    penetration
        How deep the hand was in the object at the start, by the engine's shapes, m: in PyBullet's surface, only what crosses it counts.
    poses
        (T, 7) of the object, at the start and at every look: its centre, world, m, and the quaternion (x, y, z, w, or as the engine has it)
        of its turn.
    joint_angles
        (T, J) of the hand, rad.
    interval
        s between two looks.
    """

    moved: float
    turned: float
    penetration: float
    poses: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    interval: float


class Track:
    """The poses (7,) of an object that was freed, and the joint angles (J,) of the hand, looked at every `interval`, s, `looks` times."""

    def __init__(
        self, pose: NDArray[np.float64], angles: NDArray[np.float64], *, limit: float, interval: float, looks: int, whole: bool
    ) -> None:
        self.poses, self.angles = [pose], [angles]
        self.limit, self.interval, self.looks, self.whole = limit, interval, looks, whole

    def ends(self, pose: NDArray[np.float64], angles: NDArray[np.float64]) -> bool:
        """Add a look, and tell whether the object is beyond the limit, or rests, or, unless `whole`, is too slow to get there in time."""
        self.poses.append(pose)
        self.angles.append(angles)
        moved = length(pose[:3] - self.poses[0][:3])
        if not moved <= self.limit:  # where it is not a number, either
            return True
        if len(self.poses) <= RESTING_LOOKS:
            return False
        change = pose - self.poses[-1 - RESTING_LOOKS]
        if np.abs(change).max() < RESTING_CHANGE:
            return True
        times = SAFETY * (self.looks - (len(self.poses) - 1)) / RESTING_LOOKS
        return not self.whole and bool(moved + times * length(change[:3]) < self.limit and times * np.abs(change[3:]).max() < SURE_TURN)

    def motion(self, penetration: float) -> Motion:
        """Compare the last pose with the first."""
        first, last = self.poses[0], self.poses[-1]
        moved = turned = np.inf
        if np.isfinite(last).all():
            # of unit quaternions, which have two signs
            difference = min(float(length(last[3:] - first[3:])), float(length(last[3:] + first[3:])))
            moved, turned = float(length(last[:3] - first[:3])), 4 * float(np.arcsin(min(difference / 2, 1.0)))
        return Motion(moved, turned, penetration, np.array(self.poses), np.array(self.angles), self.interval)


def closing_path(grasp: StoredGrasp) -> NDArray[np.float64]:
    """Interpolate linearly from the pre-grasp to the grasp and to the squeeze; (stages, J), rad, without the first."""
    postures = grasp.pregrasp, grasp.joint_angles, grasp.squeeze
    return np.concatenate([np.linspace(a, b, CLOSING_STAGES + 1)[1:] for a, b in pairwise(postures)])

"""The motion of a freed object and of the hand that grasps it, and the path on which the hand closes."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.kernels.geometry.transforms import length

RESTING_LOOKS, RESTING_CHANGE = 12, 1e-3
"""An object rests when its pose, m and quaternion, changes by less in this number of looks, a quarter of a second; a sliding object
accelerates. In 50 grasps of ten objects, none moved by 0.1 mm in the remaining time."""
CLOSING_STAGES, CLOSING_SECONDS = 10, 0.4
"""Motor targets from one posture to the next when a hand closes, and the time that this takes, as in DexGraspBench."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of an object that was freed in a grasp, and of the hand.

    Attributes
    ----------
    moved, turned, speed
        Final displacement of the object's centre, m, and its rotation angle, rad; and the speed of the centre, m/s: its displacement in
        the last `RESTING_LOOKS` looks. Infinite if the engine's numbers overflow.
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
    speed: float
    penetration: float
    poses: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    interval: float


class Track:
    """Record the poses (7,) of a freed object and the joint angles (J,) of the hand every `interval`, s."""

    def __init__(self, pose: NDArray[np.float64], angles: NDArray[np.float64], *, limit: float, interval: float) -> None:
        self.poses, self.angles = [pose], [angles]
        self.limit, self.interval = limit, interval

    def ends(self, pose: NDArray[np.float64], angles: NDArray[np.float64]) -> bool:
        """Add a look, and tell whether the object is beyond the limit or rests."""
        self.poses.append(pose)
        self.angles.append(angles)
        moved = length(pose[:3] - self.poses[0][:3])
        if not moved <= self.limit:  # NaN ends the test, too
            return True
        return len(self.poses) > RESTING_LOOKS and bool(np.abs(pose - self.poses[-1 - RESTING_LOOKS]).max() < RESTING_CHANGE)

    def motion(self, penetration: float) -> Motion:
        """Compare the last pose with the first."""
        first, last = self.poses[0], self.poses[-1]
        moved = turned = speed = np.inf
        if np.isfinite(last).all():
            # of unit quaternions, which have two signs
            difference = min(float(length(last[3:] - first[3:])), float(length(last[3:] + first[3:])))
            moved, turned = float(length(last[:3] - first[:3])), 4 * float(np.arcsin(min(difference / 2, 1.0)))
            recent = self.poses[-1 - RESTING_LOOKS :]
            speed = float(length(last[:3] - recent[0][:3])) / (self.interval * max(len(recent) - 1, 1))
        return Motion(moved, turned, speed, penetration, np.array(self.poses), np.array(self.angles), self.interval)


def closing_path(grasp: StoredGrasp) -> NDArray[np.float64]:
    """Interpolate linearly from the pre-grasp to the grasp and to the squeeze; (stages, J), rad, without the first."""
    postures = grasp.pregrasp, grasp.joint_angles, grasp.squeeze
    return np.concatenate([np.linspace(a, b, CLOSING_STAGES + 1)[1:] for a, b in pairwise(postures)])

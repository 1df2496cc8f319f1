"""The motion of an object that was freed in a grasp, and what counts as held."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.transforms import length

WITHIN, REST = 0.1, 0.05
"""m from where it was, and m/s, up to which an object is held at the end: then it rests in the hand. Motors and gels give way by up to
2 cm, some objects slip by up to 8 cm until they are caught, and what rests may creep at 1 cm/s; what falls is faster than 10 cm/s."""
RESTING_SAMPLES, RESTING_CHANGE = 12, 1e-3
"""An object rests when its pose, m and quaternion, changes by less in this number of samples, a quarter of a second; a sliding object
accelerates. In 50 grasps of ten objects, none moved by 0.1 mm in the remaining time."""


def is_held(moved: ArrayLike, speed: ArrayLike) -> Mask:
    """Check whether objects are held, by how far, m, and how fast, m/s, they moved at the end."""
    return (np.asarray(moved) <= WITHIN) & (np.asarray(speed) <= REST)


@dataclass(frozen=True)
class Motion:
    """The motion of an object that was freed in a grasp: infinite if the engine's numbers overflow."""

    moved: float  # m, displacement of its centre at the end
    turned: float  # rad
    speed: float  # m/s, of its centre: its displacement in the last `RESTING_SAMPLES` samples
    penetration: float  # m, depth of the hand in the object at the start; in PyBullet's surface, only what crosses it counts


class Track:
    """Record the pose (7,) of a freed object, its centre, m, and its quaternion, every `interval`, s."""

    def __init__(self, pose: Array, *, limit: float, interval: float) -> None:
        self.poses, self.limit, self.interval = [pose], limit, interval

    def ends(self, pose: Array) -> bool:
        """Add a sample, and tell whether the object is beyond the limit or rests."""
        self.poses.append(pose)
        if not length(pose[:3] - self.poses[0][:3]) <= self.limit:  # NaN ends the test, too
            return True
        return len(self.poses) > RESTING_SAMPLES and bool(np.abs(pose - self.poses[-1 - RESTING_SAMPLES]).max() < RESTING_CHANGE)

    def motion(self, penetration: float) -> Motion:
        """Compare the last pose with the first."""
        first, last = self.poses[0], self.poses[-1]
        if not np.isfinite(last).all():
            return Motion(np.inf, np.inf, np.inf, penetration)
        # of unit quaternions, which have two signs
        difference = min(float(length(last[3:] - first[3:])), float(length(last[3:] + first[3:])))
        moved, turned = float(length(last[:3] - first[:3])), 4 * float(np.arcsin(min(difference / 2, 1.0)))
        recent = self.poses[-1 - RESTING_SAMPLES :]
        speed = float(length(last[:3] - recent[0][:3])) / (self.interval * max(len(recent) - 1, 1))
        return Motion(moved, turned, speed, penetration)

"""Tests of grasps: the accelerations under which an object must stay, the motion of the fingers, and how far the object may move."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.physics.hold_test import GRAVITY, HoldTest
from pipeline.physics.motion import Motion

AXES = tuple(tuple(sign * axis) for axis in np.eye(3) for sign in (-1.0, 1.0))
"""The six directions, in DexGraspBench's order."""
WITHIN, REST = 0.1, 0.05
"""m from where it was, and m/s, up to which an object is held at the end: then it rests in the hand. Motors and gels give way by up to
2 cm, some objects slip by up to 8 cm until they are caught, and what rests may creep at 1 cm/s; what falls is faster than 10 cm/s."""


@dataclass(frozen=True)
class GraspTest:
    """A test of grasps.

    Attributes
    ----------
    mass, friction, torsion
        Of the object, kg, and between it and the hand; None for the hand's own (see `HoldTest`).
    acceleration, directions
        m/s², and the unit vectors along which it acts in turn, world.
    seconds
        How long each.
    moved, turned, speed
        m and rad that the object's centre and the object may move, and m/s at which the centre may move at the end.
    closes
        Whether the fingers first close from the pre-grasp; else they begin in the grasp.
    penetration
        m that the hand may be in the object at the start.
    """

    mass: float = 0.2
    friction: float | None = None
    torsion: float | None = None
    acceleration: float = -GRAVITY
    directions: tuple[tuple[float, ...], ...] = AXES
    seconds: float = 1.0
    moved: float = WITHIN
    turned: float = np.inf
    speed: float = REST
    closes: bool = False
    penetration: float = np.inf

    def motions(self, test: HoldTest, grasp: StoredGrasp) -> Iterator[Motion]:
        """Record the motion of the object that `test` has loaded, freed in a grasp, along one direction after the other."""
        for direction in self.directions:
            yield test.hold(
                grasp,
                closes=self.closes,
                acceleration=[self.acceleration * component for component in direction],
                seconds=self.seconds,
                limit=self.moved,
            )

    def holds(self, test: HoldTest, grasp: StoredGrasp) -> bool:
        """Check whether a grasp holds in every direction; the first in which it does not ends the test."""
        return all(self.passes(motion) for motion in self.motions(test, grasp))

    def passes(self, motion: Motion) -> bool:
        """Check whether a motion is that of an object that is held."""
        return bool(self.stays(motion.moved, motion.speed)) and motion.turned <= self.turned and motion.penetration <= self.penetration

    def stays(self, moved: ArrayLike, speed: ArrayLike) -> NDArray[np.bool_]:
        """Check whether objects stay in the hand, by how far, m, and how fast, m/s, they moved at the end."""
        return (np.asarray(moved) <= self.moved) & (np.asarray(speed) <= self.speed)


GRASP_TESTS = {
    "lift": GraspTest(directions=((0.0, 0.0, -1.0),)),
    "six-directions": GraspTest(),
    "six-directions-easy": GraspTest(mass=0.1, friction=1.0),
    "dexgraspbench": GraspTest(
        mass=0.1,
        friction=0.6,
        torsion=0.02,
        acceleration=10.0,
        seconds=2.0,
        moved=0.05,
        turned=np.deg2rad(15.0),
        speed=np.inf,
        closes=True,
        penetration=0.01,
    ),
}
"""`lift`: the weight alone. `six-directions`: the weight along each axis, 0.2 kg with the hand's friction; `-easy`: 0.1 kg with friction 1.
`dexgraspbench`: the force-closure test of DexGraspBench (Chen et al. 2024, `fc_mocap.py`), except that our gels have springs, and that the
acceleration acts on the fingers too."""

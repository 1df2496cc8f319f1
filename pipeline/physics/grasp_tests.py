"""Tests of grasps: the accelerations under which an object must stay, the motion of the fingers, and how far the object may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.physics.hold_test import GRAVITY, HoldTest

AXES = tuple(tuple(sign * axis) for axis in np.eye(3) for sign in (-1.0, 1.0))
"""The six directions, in DexGraspBench's order."""


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
    moved, turned
        m and rad that the object's centre and the object may move.
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
    moved: float = 0.02
    turned: float = np.inf
    closes: bool = False
    penetration: float = np.inf

    def holds(self, test: HoldTest, grasp: StoredGrasp) -> bool:
        """Check whether a grasp of the object that `test` has loaded holds in every direction; the first in which it does not ends it."""
        return all(self.holds_against(test, grasp, direction) for direction in self.directions)

    def holds_against(self, test: HoldTest, grasp: StoredGrasp, direction: Sequence[float]) -> bool:
        """Check whether a grasp holds while the acceleration acts along a unit vector."""
        motion = test.hold(
            grasp,
            closes=self.closes,
            acceleration=[self.acceleration * component for component in direction],
            seconds=self.seconds,
            limit=self.moved,
            whole=np.isfinite(self.turned),  # the turn is known only at the end
        )
        return motion.moved <= self.moved and motion.turned <= self.turned and motion.penetration <= self.penetration


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
        closes=True,
        penetration=0.01,
    ),
}
"""`lift`: the weight alone. `six-directions`: the weight along each axis, 0.2 kg with the hand's friction; `-easy`: 0.1 kg with friction 1.
`dexgraspbench`: the force-closure test of DexGraspBench (Chen et al. 2024, `fc_mocap.py`), except that our gels have springs, and that the
acceleration acts on the fingers too."""

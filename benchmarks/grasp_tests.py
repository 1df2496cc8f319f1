"""Tests of grasps: the accelerations under which an object must stay, the motion of the fingers, and how far the object may move."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from benchmarks.mujoco_hold_test import MujocoHoldTest
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hold_test import HOLD_TESTS, REST, WITHIN, HoldTest, Motion

Engine = Literal["pybullet", "mujoco"]
CLOSING_STAGES, CLOSING_SECONDS = 10, 0.4
"""Motor targets from one posture to the next when a hand closes, and the time that this takes, as in DexGraspBench."""


@dataclass(frozen=True)
class GraspTest:
    """A test of grasps."""

    mass: float = 0.2  # of the object, kg
    friction: float | None = None  # between object and hand; None: the hand's
    torsion: float | None = None  # see `HoldTest`
    accelerations: tuple[tuple[float, ...], ...] = HOLD_TESTS["six"]  # on the object, one after the other, world, m/s²
    seconds: float = 1.0  # each
    moved: float = WITHIN  # m that the object's centre may move
    turned: float = np.inf  # rad that the object may turn
    speed: float = REST  # m/s at which the centre may move at the end
    closes: bool = False  # whether the fingers first close from the pre-grasp; else they begin in the grasp
    penetration: float = np.inf  # m that the hand may be in the object at the start

    def open(self, engine: Engine, hand: Hand, sensors: Sequence[Sensor]) -> HoldTest:
        """Open a hold test in an engine with this mass and friction."""
        hold_test = MujocoHoldTest if engine == "mujoco" else HoldTest
        rubbed = hand if self.friction is None else replace(hand, friction=self.friction)
        return hold_test(rubbed, sensors, mass=self.mass, torsion=self.torsion)

    def holds(self, test: HoldTest, grasp: Grasp) -> bool:
        """Check whether a grasp of the loaded object holds; the first acceleration under which it does not ends the test."""
        postures = (grasp.pregrasp_angles, grasp.joint_angles, grasp.squeeze_angles) if self.closes else ()
        path = [posture for first, last in pairwise(postures) for posture in np.linspace(first, last, CLOSING_STAGES + 1)[1:]]
        step = CLOSING_SECONDS / CLOSING_STAGES
        return all(
            self.passes(test.hold(grasp, acceleration=each, seconds=self.seconds, limit=self.moved, path=path, path_seconds=step))
            for each in self.accelerations
        )

    def passes(self, motion: Motion) -> bool:
        """Check whether a motion is that of an object that is held."""
        rests = motion.moved <= self.moved and motion.speed <= self.speed
        return rests and motion.turned <= self.turned and motion.penetration <= self.penetration


GRASP_TESTS = {
    "lift": GraspTest(accelerations=HOLD_TESTS["lift"]),
    "six-directions": GraspTest(),
    "six-directions-easy": GraspTest(mass=0.1, friction=1.0),
    "dexgraspbench": GraspTest(
        mass=0.1,
        friction=0.6,
        torsion=0.02,
        accelerations=tuple(tuple((sign * axis).tolist()) for axis in 10.0 * np.eye(3) for sign in (-1, 1)),
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

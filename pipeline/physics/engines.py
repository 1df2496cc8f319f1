"""The physics engines in which a grasp can be tested."""

from collections.abc import Sequence
from typing import Literal

from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.grasp_tests import GraspTest
from pipeline.physics.hold_test import HoldTest
from pipeline.physics.mujoco_engine import MujocoHoldTest
from pipeline.physics.pybullet_engine import PybulletHoldTest

Engine = Literal["pybullet", "mujoco"]


def hold_test(
    engine: Engine, hand: Hand, sensors: Sequence[Sensor], *, mass: float, friction: float | None = None, torsion: float | None = None
) -> HoldTest:
    """Open a hold test in an engine; parameters are those of `HoldTest`.

    Raises
    ------
    InvalidInput
        The engine is not installed.
    """
    if engine == "mujoco":
        return MujocoHoldTest(hand, sensors, mass=mass, friction=friction, torsion=torsion)
    return PybulletHoldTest(hand, sensors, mass=mass, friction=friction, torsion=torsion)


def open_test(test: GraspTest, engine: Engine, hand: Hand, sensors: Sequence[Sensor]) -> HoldTest:
    """Open a hold test in an engine with the mass and the friction of a test of grasps."""
    return hold_test(engine, hand, sensors, mass=test.mass, friction=test.friction, torsion=test.torsion)

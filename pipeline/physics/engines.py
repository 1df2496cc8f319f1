"""The physics engines in which a grasp can be tested."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hold_test import HoldTest
from pipeline.physics.mujoco_engine import MujocoHoldTest

Engine = Literal["pybullet", "mujoco"]


def hold_test(
    engine: Engine, hand: Hand, sensors: Sequence[Sensor], *, mass: float, friction: float | None = None, torsion: float | None = None
) -> HoldTest | MujocoHoldTest:
    """Open a hold test in an engine; parameters are those of `HoldTest`.

    Raises
    ------
    InvalidInput
        The engine is not installed.
    """
    tests: dict[str, type[HoldTest] | type[MujocoHoldTest]] = {"pybullet": HoldTest, "mujoco": MujocoHoldTest}
    return tests[engine](hand, sensors, mass=mass, friction=friction, torsion=torsion)

"""Whether a grasp holds: the object is freed and gravity points along one or six directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.physics.hold_test import HoldTest
from pipeline.physics.simulation import GRAVITY
from stages.simulate_grasps.grasp_search import Grasp

STAYS = 0.02
"""m that the object's centre may move: what slips or turns less is in the hand for good."""
SIX = GRAVITY * np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
"""(6, 3) m/s², gravity's own direction first."""
ACCELERATIONS = {"none": SIX[:0], "lift": SIX[:1], "six": SIX}


def passes(test: HoldTest, grasp: Grasp, which: str) -> bool:
    """Tell whether a grasp passes the hold test, a key of `ACCELERATIONS`; the first failure ends it."""
    return all(_stays(test, grasp, acceleration) for acceleration in ACCELERATIONS[which])


def directions_held(test: HoldTest, grasp: Grasp, which: str) -> NDArray[np.bool_]:
    """Test every direction of a hold test, (D,) bool; of a grasp that has passed none again."""
    directions = ACCELERATIONS[which]
    if grasp.holds:
        return np.ones(len(directions), bool)
    return np.array([_stays(test, grasp, acceleration) for acceleration in directions])


def _stays(test: HoldTest, grasp: Grasp, acceleration: NDArray[np.float64]) -> bool:
    motion = test.hold(grasp.hand_pose, grasp.joint_angles, grasp.contacts, acceleration=acceleration.tolist(), limit=STAYS)
    return motion.moved <= STAYS

"""The pre-grasp posture: every sensor drawn back along its normal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose, solve_3x3
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand

DIFFERENCE = 1e-5
"""rad, step of the finite differences."""
DAMPING = 1e-3
"""m, of the damped least squares (Wampler 1986): below it a direction counts as one that the finger cannot move in."""


def pregrasp_angles(hand: Hand, joint_angles: NDArray[np.float64], distances: Sequence[float]) -> NDArray[np.float64]:
    """Compute joint angles from which closing moves every sensor a given distance along its normal.

    Parameters
    ----------
    hand
        J joints.
    joint_angles
        (J,) at the end of the closing motion, rad.
    distances
        N distances, m.

    Returns
    -------
    (N, J) float64, rad, within the limits.

    Notes
    -----
    One damped least-squares step with the Jacobian of the sensors' positions: right to first order only. A finger with several sensors
    takes the mean of their steps.
    """
    home = np.eye(4)
    rest = sensor_poses(hand, home, joint_angles)  # (S, 4, 4)
    moved = sensor_poses(hand, home, joint_angles + DIFFERENCE * np.eye(len(joint_angles)))  # (J, S, 4, 4)
    jacobian = np.moveaxis(moved[..., :3, 3] - rest[:, :3, 3], 0, -1) / DIFFERENCE  # (S, 3, J)
    opened = np.repeat(joint_angles[None], len(distances), axis=0)
    for finger in hand.fingers:
        joints = list(finger.joints)
        for s in finger.sensors:
            own = jacobian[s][:, joints]
            for row, distance in enumerate(distances):
                step = solve_3x3(compose(own, own.T) + DAMPING**2 * np.eye(3), distance * rest[s, :3, 2])
                opened[row, joints] -= (own * step[:, None]).sum(axis=0) / len(finger.sensors)
    return np.clip(opened, hand.lower, hand.upper)

"""Pre-grasps: a palm tangent to the object (supplement 1.3), and fingers opened along their sensors' normals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.kernels.geometry.transforms import compose, invert_pose, length, sin_cos, solve_3x3
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand

DIFFERENCE_STEP = 1e-5
"""rad, step of the finite differences."""
DAMPING = 1e-3
"""m, of the damped least squares (Wampler 1986): below it the finger counts as unable to move in a direction."""


def tangent_palm_pose(
    hand: Hand, point: NDArray[np.float64], normal: NDArray[np.float64], *, distance: float, angle: float
) -> NDArray[np.float64]:
    """Compute the pose of a hand whose palm faces a surface point.

    Parameters
    ----------
    hand
        Gives the palm's centre and outward normal.
    point, normal
        (3,) of the surface, world, m; the normal points outward.
    distance
        From the point to the palm's centre along the normal, m.
    angle
        Of the hand about the normal, rad; 0 is an arbitrary direction that depends on the normal alone.

    Returns
    -------
    (4, 4) float64, frame of the root link in the world.

    Raises
    ------
    ValueError
        Point or normal is NaN or infinite, or the normal is zero.
    """
    longest = np.abs(normal).max()
    if not (np.isfinite(point).all() and 0 < longest < np.inf):
        raise ValueError(f"no hand can face the point {point} with normal {normal}: they must be finite, the normal not zero")
    normal = normal / longest
    palm = frame_along(-hand.palm_facing, 0.0, hand.palm_centre)
    return compose(frame_along(normal, angle, point + distance * normal / length(normal)), invert_pose(palm))


def frame_along(z: NDArray[np.float64], angle: ArrayLike, origin: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make right-handed frames with a given third axis.

    Parameters
    ----------
    z
        (..., 3) axis, of any length but 0.
    angle
        (...) of the frame about it, rad; 0 is an arbitrary direction that depends on the axis alone.
    origin
        (..., 3) m.

    Returns
    -------
    (..., 4, 4) float64.
    """
    z = z / length(z)[..., None]
    x = np.cross(np.eye(3)[np.abs(z).argmin(axis=-1)], z)
    x /= length(x)[..., None]
    y = np.cross(z, x)
    sin, cos = (values[..., None] for values in sin_cos(angle))
    frame = np.broadcast_to(np.eye(4), (*z.shape[:-1], 4, 4)).copy()
    frame[..., :3, :3] = np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=-1)
    frame[..., :3, 3] = origin
    return frame


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
    poses = sensor_poses(hand, home, joint_angles)  # (S, 4, 4)
    nudged_poses = sensor_poses(hand, home, joint_angles + DIFFERENCE_STEP * np.eye(len(joint_angles)))  # (J, S, 4, 4)
    jacobian = np.moveaxis(nudged_poses[..., :3, 3] - poses[:, :3, 3], 0, -1) / DIFFERENCE_STEP  # (S, 3, J)
    opened = np.repeat(joint_angles[None], len(distances), axis=0)
    for finger in hand.fingers:
        joints = list(finger.joints)
        for s in finger.sensors:
            finger_jacobian = jacobian[s][:, joints]
            for row, distance in enumerate(distances):
                step = solve_3x3(compose(finger_jacobian, finger_jacobian.T) + DAMPING**2 * np.eye(3), distance * poses[s, :3, 2])
                opened[row, joints] -= (finger_jacobian * step[:, None]).sum(axis=0) / len(finger.sensors)
    return np.clip(opened, hand.lower, hand.upper)

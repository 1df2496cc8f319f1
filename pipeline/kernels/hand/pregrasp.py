"""Pre-grasps: a palm tangent to the object (supplement 1.3), and fingers opened along their sensors' normals."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.transforms import compose, invert_pose, length, sin_cos, solve_3x3
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand

DIFFERENCE_STEP = 1e-5  # rad, of finite differences
DAMPING = 1e-3  # m, of the damped least squares (Wampler 1986): below it the finger cannot move in a direction
LIMIT_DAMPING = 1e-2  # m, where joints meet their limits: what the others can do alone is mostly sideways
MAX_PIVOTS = 10_000  # exchanges of joints at their limits; fingers of seven joints took 169 at most
ROUNDED = 1e-6  # rad that a step may pass a limit: else rounding would decide whether a joint at its limit meets it


def tangent_palm_pose(
    hand: Hand,
    point: Array,  # (3,) of the surface, world, m
    normal: Array,  # (3,) outward there, of any length but 0
    *,
    distance: float,  # m, from the point to the palm's centre along the normal
    angle: float,  # rad, about the normal; 0 is an arbitrary direction that depends on the normal alone
) -> Array:  # (4, 4) root link to world, m
    """Compute the pose of a hand whose palm faces a surface point."""
    longest = np.abs(normal).max()
    if not (np.isfinite(point).all() and 0 < longest < np.inf):
        raise ValueError(f"no hand can face the point {point} with normal {normal}: they must be finite, the normal not zero")
    normal = normal / longest
    return compose(frame_along(normal, angle, point + distance * normal / length(normal)), _root_in_palm(hand))


@lru_cache(maxsize=16)
def _root_in_palm(hand: Hand) -> Array:
    return invert_pose(frame_along(-hand.palm_facing, 0.0, hand.palm_centre))


def frame_along(
    z: Array,  # (..., 3) axis, of any length but 0
    angle: ArrayLike,  # (...) rad, about the axis; 0 is an arbitrary direction that depends on the axis alone
    origin: Array,  # (..., 3) m
) -> Array:  # (..., 4, 4)
    """Make right-handed frames with a given third axis."""
    z = z / length(z)[..., None]
    x = np.cross(np.eye(3)[np.abs(z).argmin(axis=-1)], z)
    x /= length(x)[..., None]
    y = np.cross(z, x)
    sin, cos = (values[..., None] for values in sin_cos(angle))
    frame = np.broadcast_to(np.eye(4), (*z.shape[:-1], 4, 4)).copy()
    frame[..., :3, :3] = np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=-1)
    frame[..., :3, 3] = origin
    return frame


def pregrasp_angles(
    hand: Hand,
    joint_angles: Array,  # (J,) at the end of the closing motion, rad
    distances: Sequence[float],  # (N,) m
) -> Array:  # (N, J) rad, within the limits
    """Compute joint angles from which closing moves every sensor a given distance along its normal, right to first order.

    One damped least-squares step with the Jacobian of the sensors' positions, within the limits. Where a joint meets its limit, the
    finger's others do what they can of its share. A finger with several sensors takes the mean of their steps.
    """
    home = np.eye(4)
    poses = sensor_poses(hand, home, joint_angles)  # (S, 4, 4)
    nudged_poses = sensor_poses(hand, home, joint_angles + DIFFERENCE_STEP * np.eye(len(joint_angles)))  # (J, S, 4, 4)
    jacobian = np.moveaxis(nudged_poses[..., :3, 3] - poses[:, :3, 3], 0, -1) / DIFFERENCE_STEP  # (S, 3, J)
    opened = np.repeat(joint_angles[None], len(distances), axis=0)
    for finger in hand.fingers:
        joints = list(finger.joints)
        least, most = (joint_angles[joints] - limit[joints] for limit in (hand.upper, hand.lower))
        for s in finger.sensors:
            for row, distance in enumerate(distances):
                step = _bounded_step(jacobian[s][:, joints], distance * poses[s, :3, 2], least, most)
                opened[row, joints] -= step / len(finger.sensors)
    return np.clip(opened, hand.lower, hand.upper)


@compiled
def _bounded_step(jacobian: Array, target: Array, least: Array, most: Array) -> Array:  # (J,)
    """Find the step between two bounds (J,) that minimises |jacobian (3, J) step - target (3,)|² + damping² |step|².

    The damping is `DAMPING`, or `LIMIT_DAMPING` if that step would pass a bound. Murty's principal pivoting: joints are held at a bound,
    or freed, one at a time, until each has the step that the remaining force asks of it, or the bound that stops it. It is exact, and
    unlike scipy's solvers needs no LAPACK, whose rounding depends on the processor.
    """
    held, wanted, damping = np.zeros(len(least)), np.empty(len(least)), DAMPING  # held: -1 at the least step, 1 at the most
    rest, matrix = np.empty(3), np.empty((3, 3))
    for _ in range(int(min(3.0 ** len(least), MAX_PIVOTS))):  # each joint is free, at its least or at its most
        matrix[:] = 0.0
        for i in range(3):
            moved = 0.0
            for j in range(len(held)):
                if held[j] == 0:
                    for k in range(3):
                        matrix[i, k] += jacobian[i, j] * jacobian[k, j]
                else:
                    moved += jacobian[i, j] * (least[j] if held[j] < 0 else most[j])
            rest[i] = target[i] - moved
            matrix[i, i] += damping**2
        force, wrong, asked = solve_3x3(matrix, rest), -1, 0.0
        for j in range(len(held) - 1, -1, -1):
            wanted[j] = jacobian[0, j] * force[0] + jacobian[1, j] * force[1] + jacobian[2, j] * force[2]
            bound = -1.0 if wanted[j] - least[j] < -ROUNDED else 1.0 if wanted[j] - most[j] > ROUNDED else 0.0
            if bound != held[j]:
                wrong, asked = j, bound
        if wrong < 0:
            break
        damping = LIMIT_DAMPING
        held[wrong] = asked if held[wrong] == 0 else 0.0
    return np.minimum(np.maximum(wanted, least), most)

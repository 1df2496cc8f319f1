"""Poses of a hand whose palm is tangent to an object (supplement 1.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose, invert_pose, length, sin_cos
from pipeline.kernels.hand.model import Hand


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
    palm = _frame(-hand.palm_facing, 0.0, hand.palm_centre)
    return compose(_frame(normal, angle, point + distance * normal / length(normal)), invert_pose(palm))


def _frame(z: NDArray[np.float64], angle: float, origin: NDArray[np.float64]) -> NDArray[np.float64]:
    """A right-handed frame with the given third axis, turned about it by `angle`."""
    z = z / length(z)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= length(x)
    y = np.cross(z, x)
    sin, cos = sin_cos(angle)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([cos * x + sin * y, cos * y - sin * x, z])
    frame[:3, 3] = origin
    return frame

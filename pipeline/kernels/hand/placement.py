"""Where a hand stands: its palm tangent to the object at a random point (supplement 1.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose, invert_pose, length, sin_cos
from pipeline.kernels.hand.model import Hand


def tangent_pose(hand: Hand, point: NDArray[np.float64], normal: NDArray[np.float64], distance: float, angle: float) -> NDArray[np.float64]:
    """(4, 4) root frame of a hand whose palm faces a surface point.

    Parameters
    ----------
    hand
        Says where its palm is.
    point, normal
        (3,) of the surface, the normal outward and of any length but 0.
    distance
        From the point to the palm's centre along the normal, m.
    angle
        Of the hand about the normal, rad; 0 is an arbitrary direction that depends on the normal alone.

    Raises
    ------
    ValueError
        Point or normal is NaN or infinite, or the normal has no length.
    """
    longest = np.abs(normal).max()
    if not (np.isfinite(point).all() and 0 < longest < np.inf):
        raise ValueError(f"no hand can face the point {point} with normal {normal}: they must be finite, the normal not zero")
    normal = normal / longest  # of any length: its square may not leave float64's range
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

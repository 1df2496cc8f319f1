"""Success of a touch, and the points of the surface in the gel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.gel_surface import gel_surface, in_gel
from pipeline.kernels.touch.sensor import Sensor, check_pose, masked_points, sensor_to_world

CONTACT_MARGIN = 1e-4
"""m by which the surface must press into the gel to count as a touch; less is within the accuracy of physics."""


def touch_success(depth: np.ndarray, sensor: Sensor) -> NDArray[np.bool_]:
    """Decide whether sensors touch: 0 < min D, and D < w - `CONTACT_MARGIN` somewhere; a curved gel's w is its height there.

    Parameters
    ----------
    depth
        (..., rows, cols) m, +inf where nothing is met.
    sensor
        Gives w.

    Returns
    -------
    (...) bool.

    Raises
    ------
    ValueError
        `depth` holds NaN.

    Notes
    -----
    Depth is judged in float32, as it is stored: the stored depth gives the same mask, unless quantisation moved it across the limit.
    """
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    stored = depth.astype(np.float32).astype(np.float64)
    pressed = (stored < gel_surface(sensor) - CONTACT_MARGIN).any(axis=(-2, -1))
    return np.asarray(pressed & (stored.min(axis=(-2, -1)) > 0))


def pressed_pixels(depth: np.ndarray, sensor: Sensor) -> NDArray[np.bool_]:
    """Find the pixels that touch: 0 < D < w - `CONTACT_MARGIN`, (..., rows, cols), the rule of `touch_success`; `in_gel` has no margin."""
    judged = depth.astype(np.float32).astype(np.float64)
    return np.asarray((judged > 0) & (judged < gel_surface(sensor) - CONTACT_MARGIN))


def local_points(depth: np.ndarray, pose: np.ndarray, sensor: Sensor) -> tuple[NDArray[np.float32], np.int32]:
    """Compute the points S^loc of a depth map that lie in the gel, D < w (supplement 1.5).

    Parameters
    ----------
    depth
        (rows, cols) float32 D as stored, m.
    pose
        (4, 4) float64, sensor frame to world frame.
    sensor
        Gives the pixels' positions and w.

    Returns
    -------
    points
        (rows · cols, 3) float32, world frame, m, in row-major order of the pixels, zeros beyond the count; within 10 m of the origin
        the error of a coordinate is below 0.5 µm.
    count
        int32, the number of points.

    Raises
    ------
    ValueError
        `depth` holds NaN, or is not float32 of the sensor's shape.
    InvalidInput
        The pose is not a rigid motion; see `check_pose`.

    Notes
    -----
    The result is a function of the stored arrays alone, to the last bit.
    """
    if depth.dtype != np.float32 or depth.shape != sensor.shape:
        raise ValueError(f"depth is {depth.dtype} {depth.shape}; local points need the stored one, float32 {sensor.shape}")
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    local = masked_points(depth, in_gel(depth.astype(np.float64), sensor), sensor)
    points = np.zeros((depth.size, 3), np.float32)
    points[: len(local)] = sensor_to_world(check_pose(pose), *local.T)
    return points, np.int32(len(local))

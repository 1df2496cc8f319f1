"""Success of a touch, and the points of the surface in the gel."""

import numpy as np

from pipeline.kernels.arrays import Array32, Mask
from pipeline.kernels.touch.gel_surface import gel_surface, in_gel
from pipeline.kernels.touch.sensor import Sensor, check_pose, masked_points, sensor_to_world

CONTACT_MARGIN = 1e-4
"""m by which the surface must press into the gel to count as a touch; less is within the accuracy of physics."""


def touch_success(
    depth: np.ndarray,  # (..., rows, cols) m, +inf where nothing is met
    sensor: Sensor,
) -> Mask:  # (...)
    """Decide whether sensors touch: 0 < min D, and D < w - `CONTACT_MARGIN` somewhere.

    A curved gel's w is its height there. Depth is judged in float32, as it is stored: the stored depth gives the same
    mask, unless quantisation moved it across the limit.
    """
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    stored = depth.astype(np.float32).astype(np.float64)
    pressed = (stored < gel_surface(sensor) - CONTACT_MARGIN).any(axis=(-2, -1))
    return np.asarray(pressed & (stored.min(axis=(-2, -1)) > 0))


def pressed_pixels(depth: np.ndarray, sensor: Sensor) -> Mask:  # (..., rows, cols), as depth
    """Find the pixels that touch: 0 < D < w - `CONTACT_MARGIN`, the rule of `touch_success`; `in_gel` has no margin."""
    judged = depth.astype(np.float32).astype(np.float64)
    return np.asarray((judged > 0) & (judged < gel_surface(sensor) - CONTACT_MARGIN))


def local_points(
    depth: np.ndarray,  # (rows, cols) float32 D as stored, m
    pose: np.ndarray,  # (4, 4) float64, sensor frame to world frame
    sensor: Sensor,
) -> tuple[Array32, np.int32]:  # (rows · cols, 3) world, m, and the number of points
    """Compute the points S^loc of a depth map that lie in the gel, D < w (supplement 1.5).

    The points are in row-major order of the pixels, zeros beyond their number. Within 10 m of the origin the error of a
    coordinate is below 0.5 µm. The result is a function of the stored arrays alone, to the last bit.
    """
    if depth.dtype != np.float32 or depth.shape != sensor.shape:
        raise ValueError(f"depth is {depth.dtype} {depth.shape}; local points need the stored one, float32 {sensor.shape}")
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    local = masked_points(depth, in_gel(depth.astype(np.float64), sensor), sensor)
    points = np.zeros((depth.size, 3), np.float32)
    points[: len(local)] = sensor_to_world(check_pose(pose), *local.T)
    return points, np.int32(len(local))

"""When a sensor touches, and the surface points it then has in its gel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.face_culling import FaceBlocks
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor, check_pose, pixel_centres, sensor_to_world

CONTACT = 1e-4
"""m: how far the surface must stand in the gel to count as a touch; less is within what physics leaves open."""


def touch_success(depth: np.ndarray, sensor: Sensor) -> NDArray[np.bool_]:
    """Whether 0 < min D < w - 0.1 mm, for depths (..., rows, cols) in m: (...) bool.

    Depth is judged in float32, as it is stored: the stored arrays give the mask again, unless storing moved a depth across
    the limit, by half a step of `stored_depth`.
    """
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    nearest = depth.min(axis=(-2, -1)).astype(np.float32).astype(np.float64)
    return np.asarray((nearest > 0) & (nearest < sensor.w - CONTACT))


def is_touched(blocks: FaceBlocks, pose: np.ndarray, sensor: Sensor) -> bool:
    """`touch_success` of the depth map of a sensor at `pose` (4, 4), to which only what is in the gel matters: no ray goes farther."""
    return bool(touch_success(ray_depth(blocks, pose, gel_only(sensor)), sensor))


def gel_only(sensor: Sensor) -> Sensor:
    """The sensor, with rays that end where the gel does."""
    return sensor.model_copy(update={"range": min(sensor.w, sensor.range)})


def local_points(depth: np.ndarray, pose: np.ndarray, sensor: Sensor) -> tuple[NDArray[np.float32], np.int32]:
    """The points of a depth map that lie in the gel, S^loc: those with D < w (supplement 1.5).

    A function of the stored arrays alone, to the last bit: whoever has depth and pose has the points.

    Parameters
    ----------
    depth
        (rows, cols) float32 D as stored, m.
    pose
        (4, 4) float64, sensor frame to world frame.
    sensor
        Gives the pixels' places and w.

    Returns
    -------
    (rows · cols, 3) float32 world points, m, in row-major order of the pixels, zeros beyond the count; and the count,
    int32. A coordinate is off by half a unit in its last float32 place: 30 nm in the scene, 30 µm at a kilometre.
    """
    if depth.dtype != np.float32 or depth.shape != sensor.shape:
        raise ValueError(f"depth is {depth.dtype} {depth.shape}; local points come from the stored one, float32 {sensor.shape}")
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")
    row, col = np.nonzero(depth.astype(np.float64) < sensor.w)
    x, y = pixel_centres(sensor)
    points = np.zeros((sensor.rows * sensor.cols, 3), np.float32)
    points[: len(row)] = sensor_to_world(check_pose(pose), x[col], y[row], depth[row, col].astype(np.float64))
    return points, np.int32(len(row))

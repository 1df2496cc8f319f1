"""Selection of the faces that a sensor's rays can meet.

Valid range: objects and sensors within 100 m of the origin.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.mesh import check_coordinates
from pipeline.kernels.touch.sensor import Sensor, check_pose

SLACK = 1e-9  # m, by which boxes are enlarged: far above rounding errors within the valid range


@dataclass(frozen=True, eq=False)
class BoxedFaces:
    """The faces of a mesh with their axis-aligned bounding boxes, world frame, m."""

    corners: Array  # (3 axes, 3 corners, F)
    centre: Array  # (3, F) of each box
    half: Array  # (3, F) half extent


def box_faces(triangles: np.ndarray) -> BoxedFaces:
    """Compute the bounding boxes of a mesh's faces, once per object.

    `triangles` are (F, 3, 3) corner positions, world, m; F may be 0. Winding, duplicates and holes do not matter.
    """
    triangles = np.asarray(triangles, np.float64)
    if triangles.ndim != 3 or triangles.shape[1:] != (3, 3):
        raise ValueError(f"triangles have shape {triangles.shape}; they must be (F, 3, 3): face, corner, xyz")
    check_coordinates(triangles.reshape(-1, 3), "corners of faces")
    corners = np.ascontiguousarray(triangles.transpose(2, 1, 0))
    low, high = corners.min(axis=1), corners.max(axis=1)  # (3, F)
    return BoxedFaces(corners, (low + high) / 2, (high - low) / 2)


def cull_faces(
    faces: BoxedFaces,
    pose: np.ndarray,  # (4, 4) sensor frame to world frame
    sensor: Sensor,
) -> Array:  # (3 axes, 3 corners, N) sensor frame, m
    """Select the faces that a sensor's rays can meet, and transform them to the sensor frame.

    All faces that a ray can meet within the sensor's range are selected, and few others. The same corner has the same
    bits in every face, so shared edges stay shared.
    """
    pose = check_pose(pose)
    rotation, origin = pose[:3, :3], pose[:3, 3]
    prism_half = np.array([sensor.width, sensor.height, sensor.range])[:, None] / 2 + SLACK
    prism_centre = np.array([0.0, 0.0, sensor.range / 2])[:, None]
    centre = rotation.T @ (faces.centre - origin[:, None])  # (3, F)
    reach = np.abs(rotation.T) @ faces.half + prism_half
    candidates = np.flatnonzero(_all_axes(np.abs(centre - prism_centre) <= reach))
    offset = faces.corners[:, :, candidates] - origin[:, None, None]
    local = np.stack([r[0] * offset[0] + r[1] * offset[1] + r[2] * offset[2] for r in rotation.T])
    a, b, c = local[:, 0], local[:, 1], local[:, 2]  # (3, n): three numbers are compared faster by name than reduced along an axis
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    return local[:, :, _all_axes((low <= prism_centre + prism_half) & (high >= prism_centre - prism_half))]


def _all_axes(holds: Mask) -> Mask:
    """Combine conditions of three axes, (3, N), to (N,): true where all hold."""
    return np.asarray(holds[0] & holds[1] & holds[2])

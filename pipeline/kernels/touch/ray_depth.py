"""Orthographic depth by exact intersection: with parallel rays on a grid, ray tracing is scan conversion in float64.

Valid range: objects and sensors within 100 m of the origin, sensors from 10 µm to 10 m wide, faces of any shape, open and inside-out
meshes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.face_culling import BoxedFaces, cull_faces
from pipeline.kernels.touch.scan_conversion import scan_convert
from pipeline.kernels.touch.sensor import Sensor


def ray_depth(faces: BoxedFaces, pose: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """Compute the depth map of a sensor by exact intersection.

    Parameters
    ----------
    faces
        The object, from `box_faces`, world frame, m.
    pose
        (4, 4) float64, sensor frame to world frame.
    sensor
        Gives the grid of rays and their range.

    Returns
    -------
    (rows, cols) float64, m: distance D along +z from the sensor plane to the first surface (supplement 1.5); +inf where nothing is
    met within the sensor's range.

    Notes
    -----
    Front and back of a face count alike, and its rim belongs to it. A face seen exactly edge-on may be met at its nearest point or
    not; the rims of its neighbours are met.

    Examples
    --------
    >>> floor = np.array([[[-1, -1, 0.005], [3, -1, 0.005], [-1, 3, 0.005]]])
    >>> depth = ray_depth(box_faces(floor), np.eye(4), load_sensor("gel_16mm"))  # 5 mm everywhere
    """
    return local_depth(cull_faces(faces, pose, sensor), sensor)


def local_depth(local: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float64]:
    """Compute the depth map of faces in the sensor frame; see `ray_depth`.

    Parameters
    ----------
    local
        (3 axes, 3 corners, N) float64, sensor frame, m, from `cull_faces`.
    sensor
        Gives the grid of rays and their range.

    Returns
    -------
    (rows, cols) float64, m; +inf where nothing is met within the sensor's range.
    """
    depth = np.full(sensor.shape, np.inf)
    scan_convert(np.ascontiguousarray(local), sensor.width, sensor.height, depth)
    depth[depth > sensor.range] = np.inf
    return depth

"""Orthographic depth by exact intersection: with parallel rays on a grid, ray tracing is scan conversion in float64.

Valid range: objects and sensors within 100 m of the origin, sensors from 10 µm to 10 m wide, faces of any shape, open and inside-out
meshes.
"""

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.face_culling import BoxedFaces, cull_faces
from pipeline.kernels.touch.scan_conversion import scan_convert
from pipeline.kernels.touch.sensor import Sensor


def ray_depth(
    faces: BoxedFaces,
    pose: np.ndarray,  # (4, 4) sensor frame to world frame
    sensor: Sensor,
) -> Array:  # (rows, cols) m; +inf where nothing is met within the sensor's range
    """Compute the depth map of a sensor by exact intersection.

    D is the distance along +z to the first surface (supplement 1.5). Front and back of a face count alike, and its rim
    belongs to it. A face seen exactly edge-on may be met at its nearest point or not; the rims of its neighbours are
    met.

    >>> floor = np.array([[[-1, -1, 0.005], [3, -1, 0.005], [-1, 3, 0.005]]])
    >>> depth = ray_depth(box_faces(floor), np.eye(4), load_sensor("gel_16mm"))  # 5 mm everywhere
    """
    return local_depth(cull_faces(faces, pose, sensor), sensor)


def local_depth(
    local: Array,  # (3 axes, 3 corners, N) sensor frame, m, from `cull_faces`
    sensor: Sensor,
) -> Array:  # (rows, cols) m; +inf where nothing is met within the sensor's range
    """Compute the depth map of faces in the sensor frame; see `ray_depth`."""
    depth = np.full(sensor.shape, np.inf)
    scan_convert(np.ascontiguousarray(local), sensor.width, sensor.height, depth)
    depth[depth > sensor.range] = np.inf
    return depth

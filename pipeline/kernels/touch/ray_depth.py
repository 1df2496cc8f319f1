"""Orthographic depth by exact intersection: with parallel rays on a grid, tracing is scan conversion in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.face_culling import FaceBlocks, cull_faces
from pipeline.kernels.touch.scan_conversion import scan_convert
from pipeline.kernels.touch.sensor import Sensor

ASIDE = 1e-15
"""Sensor widths: so far beside its own ray float64 may decide on rims and take depths, for a face in the sensor's frame."""


def ray_depth(blocks: FaceBlocks, pose: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """Depth D of the first surface along +z of every pixel (supplement 1.5), by exact intersection.

    Parameters
    ----------
    blocks
        The object, from `face_blocks`, world frame, m.
    pose
        (4, 4) float64, sensor frame to world frame.
    sensor
        Gives the grid of rays and their range.

    Returns
    -------
    (rows, cols) float64, m from the sensor plane, +inf where nothing is met within the sensor's range.

    Notes
    -----
    Front and back of a face count alike, its rim belongs to it. A face that is seen exactly edge-on may be met at its
    nearest point or not; the rims of its neighbours are. A depth is that of a ray at most `ASIDE` widths beside its own,
    for faces of any shape; a scene far from the origin has the digits that float64 leaves there, 2e-13 m at a kilometre.
    """
    return face_depth(cull_faces(blocks, pose, sensor), sensor)


def face_depth(local: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float64]:
    """`ray_depth` of faces (3 axes, 3 corners, N) that are in the sensor's frame already, m."""
    depth = np.full(sensor.shape, np.inf)
    scan_convert(np.ascontiguousarray(local), sensor.width, depth)
    depth[depth > sensor.range] = np.inf
    return depth

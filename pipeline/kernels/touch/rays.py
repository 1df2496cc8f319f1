"""Orthographic depth by exact intersection: with parallel rays on a grid, tracing is scan conversion in float64."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.prism import FaceBlocks, faces_seen
from pipeline.kernels.touch.sensor import Sensor

START = 1e-9
"""m behind the sensor plane within which a surface still counts as lying on it (depth 0): rounding must not open it."""
ASIDE = 1e-15
"""Sensor widths: so far beside its own ray float64 may decide on rims and take depths, for a face in the sensor's frame."""
Point = tuple[float, float, float]
"""x in columns, y in rows (pixel centres: integers), z in m."""


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
    return grid_depth(faces_seen(blocks, pose, sensor), sensor)


def grid_depth(local: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float64]:
    """`ray_depth` of faces (3 axes, 3 corners, N) that are in the sensor's frame already, m."""
    depth = np.full(sensor.shape, np.inf)
    _scan(local, sensor.width, depth)
    depth[depth > sensor.range] = np.inf
    return depth


@compiled
def _scan(faces: NDArray[np.float64], width: float, depth: NDArray[np.float64]) -> None:
    """Lower `depth` (rows, cols) to these faces where they are nearer: a face to spans of a row, a span to pixels."""
    rows, cols = depth.shape
    for face in range(faces.shape[2]):
        a, b, c = _by_row(faces, face, width, rows, cols)
        if a[1] == c[1]:
            continue
        for row in range(int(max(math.ceil(a[1]), 0.0)), int(min(math.floor(c[1]), rows - 1.0)) + 1):
            left, z_left, right, z_right = _cross(a, b, c, float(row))
            if right > left:
                slope = (z_right - z_left) / (right - left)
            else:
                slope, z_left = 0.0, min(z_left, z_right)
            line = depth[row]
            for col in range(int(max(math.ceil(left), 0.0)), int(min(math.floor(right), cols - 1.0)) + 1):
                z = z_left + slope * (col - left)
                line[col] = min(line[col], max(0.0, z) if z >= -START else math.inf)


@compiled
def _by_row(faces: NDArray[np.float64], face: int, width: float, rows: int, cols: int) -> tuple[Point, Point, Point]:
    """A face's corners in the order of their rows."""
    a, b, c = [_in_pixels(faces, face, corner, width, rows, cols) for corner in (0, 1, 2)]
    if b[1] < a[1]:
        a, b = b, a
    if c[1] < b[1]:
        b, c = c, b
        if b[1] < a[1]:
            a, b = b, a
    return a, b, c


@compiled
def _in_pixels(faces: NDArray[np.float64], face: int, corner: int, width: float, rows: int, cols: int) -> Point:
    x, y, z = faces[0, corner, face], faces[1, corner, face], faces[2, corner, face]
    return (x / width + 0.5) * cols - 0.5, (y / width + 0.5) * rows - 0.5, z


@compiled
def _cross(a: Point, b: Point, c: Point, row: float) -> tuple[float, float, float, float]:
    """Where a row of pixel centres enters and leaves a face: columns left <= right, each with its depth.

    An edge is always run through from its lower to its upper row and meets its corners exactly. So two faces that share
    an edge cross it at the same column to the last bit: no ray slips between them.
    """
    long = _along(a, c, row)
    short = _along(b, c, row) if row > b[1] else _along(a, b, row)
    return (*short, *long) if short[0] < long[0] else (*long, *short)


@compiled
def _along(low: Point, high: Point, row: float) -> tuple[float, float]:
    """Column and depth at which an edge crosses a row."""
    if row == high[1]:
        return high[0], high[2]
    share = (row - low[1]) / (high[1] - low[1])
    return low[0] + share * (high[0] - low[0]), low[2] + share * (high[2] - low[2])

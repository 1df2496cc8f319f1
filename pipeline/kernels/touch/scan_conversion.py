"""Scan conversion of faces in float64, compiled: faces to rows of pixels, rows to depths."""

import math

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled

PLANE_TOLERANCE = 1e-9
"""m behind the sensor plane within which a surface still counts as lying on it (depth 0): rounding must not lose it."""

Point = tuple[float, float, float]  # x in columns, y in rows (pixel centres: integers), z in m


@compiled
def _edge_at_row(low: Point, high: Point, row: float) -> tuple[float, float]:
    """Compute the column and depth at which an edge crosses a row."""
    if row == high[1]:
        return high[0], high[2]
    share = (row - low[1]) / (high[1] - low[1])
    return low[0] + share * (high[0] - low[0]), low[2] + share * (high[2] - low[2])


@compiled
def _face_at_row(a: Point, b: Point, c: Point, row: float) -> tuple[float, float, float, float]:
    """Compute the columns left <= right, each with its depth, between which a row of pixel centres crosses a face.

    An edge is always followed from its lower to its upper row and meets its corners exactly. So two faces that share an edge cross
    it at the same column to the last bit: no ray passes between them.
    """
    long = _edge_at_row(a, c, row)
    short = _edge_at_row(b, c, row) if row > b[1] else _edge_at_row(a, b, row)
    return (*short, *long) if short[0] < long[0] else (*long, *short)


@compiled
def scan_convert(
    faces: Array,  # (3 axes, 3 corners, N) contiguous, sensor frame, m
    width: float,  # of the sensor plane along x, m
    height: float,  # along y, m
    depth: Array,  # (rows, cols) contiguous, m; changed in place
) -> None:
    """Lower a depth map where faces are nearer."""
    rows, cols = depth.shape
    for face in range(faces.shape[2]):
        a, b, c = [((x / width + 0.5) * cols - 0.5, (y / height + 0.5) * rows - 0.5, z) for x, y, z in faces[:, :, face].T]
        if b[1] < a[1]:  # in the order of their rows
            a, b = b, a
        if c[1] < b[1]:
            b, c = c, b
        if b[1] < a[1]:
            a, b = b, a
        if a[1] == c[1]:
            continue
        for row in range(int(max(math.ceil(a[1]), 0.0)), int(min(math.floor(c[1]), rows - 1.0)) + 1):
            left, z_left, right, z_right = _face_at_row(a, b, c, float(row))
            if right > left:
                slope = (z_right - z_left) / (right - left)
            else:
                slope, z_left = 0.0, min(z_left, z_right)
            line = depth[row]
            for col in range(int(max(math.ceil(left), 0.0)), int(min(math.floor(right), cols - 1.0)) + 1):
                z = z_left + slope * (col - left)
                line[col] = min(line[col], max(0.0, z) if z >= -PLANE_TOLERANCE else math.inf)

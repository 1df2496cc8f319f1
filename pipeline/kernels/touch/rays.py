"""Orthographic depth by exact intersection: with parallel rays on a grid, tracing is scan conversion in float64."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.prism import FaceBlocks, faces_seen
from pipeline.kernels.touch.sensor import Sensor

START = 1e-9
"""m behind the sensor plane within which a surface still counts as lying on it (depth 0): rounding must not open it."""
ASIDE = 1e-15
"""Sensor widths: so far beside its own ray float64 may decide on rims and take depths, for a face in the sensor's frame."""
BATCH = 1_000_000
"""Pixels of faces' boxes at a time, about 100 MB: thousands of faces on top of each other may not fill the memory."""
LAYERS = 20
"""Times that faces' boxes cover the sensor from which on the nearest are taken first: below it sorting costs more than it saves."""
FRONT = 8
"""So many of those times are taken first, and hide of the rest what lies behind them."""


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
    if local.shape[2]:
        for number, faces in enumerate(_batches(pixel_faces(local, sensor), sensor)):
            _scan(faces, depth, hiding=number > 0)
    depth[depth > sensor.range] = np.inf
    return depth


def _scan(faces: NDArray[np.float64], depth: NDArray[np.float64], hiding: bool) -> None:
    """Lower `depth` (rows, cols) to these faces where they are nearer: faces to spans of a row, spans to pixels.

    With `hiding`, spans behind all that `depth` shows there are left out before they become pixels.
    """
    rows, cols = depth.shape
    face, row = _expand(np.maximum(np.ceil(faces[1, 0]), 0), np.minimum(np.floor(faces[1, 2]), rows - 1))
    left, right, z_left, z_right = _cross(faces, face, row.astype(np.float64))
    first, last = np.maximum(np.ceil(left), 0), np.minimum(np.floor(right), cols - 1)
    if hiding:
        kept = _in_sight(row, first, last, np.minimum(z_left, z_right), depth)
        row, first, last = row[kept], first[kept], last[kept]
        left, right, z_left, z_right = left[kept], right[kept], z_left[kept], z_right[kept]
    width = right - left
    slope = np.divide(z_right - z_left, width, out=np.zeros_like(width), where=width > 0)
    z_left = np.where(width > 0, z_left, np.minimum(z_left, z_right))
    span, col = _expand(first, last)
    z = col - left[span]
    z *= slope[span]
    z += z_left[span]
    pixel = col
    pixel += (row * cols)[span]
    if faces[2].min(initial=0.0) < 0:  # some lie behind the sensor plane
        ahead = z >= -START
        pixel, z = pixel[ahead], z[ahead]
    np.minimum.at(depth.reshape(-1), pixel, np.maximum(z, 0.0, out=z))


def _in_sight(
    row: NDArray[np.intp], first: NDArray[np.float64], last: NDArray[np.float64], near: NDArray[np.float64], depth: NDArray[np.float64]
) -> NDArray[np.intp]:
    """Which spans may lower a pixel: those not behind all that their row shows, and those with a pixel still open."""
    still_open = np.isinf(depth)
    farthest = np.where(still_open, -np.inf, depth).max(axis=1)
    opened = np.zeros((depth.shape[0], depth.shape[1] + 1), np.intp)
    np.cumsum(still_open, axis=1, out=opened[:, 1:])
    hold = np.flatnonzero(first <= last)
    row, near = row[hold], near[hold]
    ends = opened[row, last[hold].astype(np.intp) + 1] - opened[row, first[hold].astype(np.intp)]
    kept: NDArray[np.intp] = hold[(near <= farthest[row]) | (ends > 0)]
    return kept


def _batches(faces: NDArray[np.float64], sensor: Sensor) -> Iterator[NDArray[np.float64]]:
    """Runs of faces whose boxes hold about `BATCH` pixels; where many lie behind each other, the nearest first."""
    last = np.array([sensor.cols - 1, sensor.rows - 1])[:, None]
    sides = np.minimum(faces[:2].max(axis=1), last) - np.maximum(faces[:2].min(axis=1), 0) + 1
    pixels = np.maximum(sides, 0).prod(axis=0)
    size, begin = sensor.rows * sensor.cols, BATCH
    if pixels.sum() > LAYERS * size:
        order = np.argsort(faces[2].min(axis=0), kind="stable")
        faces, pixels, begin = faces[:, :, order], pixels[order], FRONT * size
    ends = np.cumsum(pixels)
    cuts = np.searchsorted(ends, np.arange(begin, ends[-1] if len(ends) else 0, BATCH))
    yield from np.split(faces, np.unique(cuts), axis=2)


def pixel_faces(local: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float64]:
    """Of faces (3 axes, 3 corners, N) in the sensor's frame, m, those that may cover a pixel's centre.

    x in columns, y in rows (pixel centres: integers), z in m; corners in row order.
    """
    x = (local[0] / sensor.width + 0.5) * sensor.cols - 0.5
    y = (local[1] / sensor.width + 0.5) * sensor.rows - 0.5
    faces = np.stack([x, y, local[2]])
    low, high = np.ceil(faces.min(axis=1)), np.floor(faces.max(axis=1))  # (3, N)
    covers = (low[0] <= high[0]) & (low[1] <= high[1]) & (faces[1].min(axis=0) < faces[1].max(axis=0))
    faces = faces[:, :, covers]
    order = np.argsort(faces[1], axis=0, kind="stable")
    return np.take_along_axis(faces, order[None], axis=1)


def _expand(first: NDArray[np.float64], last: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All integers first..last (inclusive) of every interval: the interval's index and the integer."""
    count = np.maximum(last - first + 1, 0).astype(np.intp)
    owner = np.repeat(np.arange(len(count)), count)
    ends = np.cumsum(count)
    return owner, np.arange(len(owner)) + (first.astype(np.intp) - ends + count)[owner]


def _cross(faces: NDArray[np.float64], face: NDArray[np.intp], row: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Where a row of pixel centres enters and leaves a face: columns left <= right, and the depths there.

    An edge is always run through from its lower to its upper row and meets its corners exactly. So two faces that share
    an edge cross it at the same column to the last bit: no ray slips between them.
    """
    a, b, c = (faces[:, k, face] for k in range(3))  # each (xyz, spans), rows a <= b <= c
    upper = row > b[1]
    long = _along(a, c, row)
    short = _along(np.where(upper, b, a), np.where(upper, c, b), row)
    swap = short[0] < long[0]
    (left, z_left), (right, z_right) = np.where(swap, short, long), np.where(swap, long, short)
    return left, right, z_left, z_right


def _along(low: NDArray[np.float64], high: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, spans): column and depth at which an edge crosses a row."""
    rise = high[1] - low[1]
    share = np.divide(row - low[1], rise, out=np.zeros_like(rise), where=rise > 0)
    return np.where(row == high[1], high[::2], low[::2] + share * (high[::2] - low[::2]))

"""The visible surface of an object in a depth image as small charts, in the form of touch charts."""

import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Floats, Mask

WIDTH = 0.016  # m per side of a chart beside an object of 0.5 m, as wide as a fingertip's gel; on others in proportion
MEASURED = 0.9  # share of a chart's pixels that must be measured, its corners among them; the others are filled in
UNEVEN = 2e-3, 1e-3  # m: RMS of depths around a chart, above which a window holds an edge; in proportion, but not below a camera's noise
STEEP = 2.0  # slope against the image plane above which a surface is seen at too flat an angle
CHARTS = 64  # most charts, spread evenly over the surface; five grasps make twenty touch charts
RIM = 1  # pixels at the rim of the mask that are dropped: cameras mix depths there


def visible_charts(
    depth: Floats,  # (rows, cols) along the viewing direction, m; NaN where nothing was measured
    mask: Mask,  # (rows, cols) where the image shows the object
    intrinsic: Floats,  # (3, 3) camera matrix; pixel centres at ½
    side: int,  # vertices along a side of a chart
    scale: float = 1.0,  # of the object, to 0.5 m
) -> Array:  # (T, side², 3) camera frame (+x along columns, +y along rows, +z ahead), m; T may be 0
    """Fit charts to the visible surface, ordered as touch charts, so that normals point away from the camera, into the object.

    The image is cut into windows that are `WIDTH / scale` wide at the object's median depth. A quadric is fitted to the depths of each, by
    least squares: a chart is smooth where the camera's depth is noisy.
    """
    usable = scipy.ndimage.binary_erosion(mask, iterations=RIM) & np.isfinite(depth)
    if not usable.any():
        return np.zeros((0, side * side, 3))
    focal = intrinsic[[0, 1], [0, 1]]
    rows, cols = (max(2, round(WIDTH / scale * length / float(np.median(depth[usable])))) for length in focal[::-1])
    row, col = (np.flatnonzero(usable.any(axis=axis)) for axis in (1, 0))
    charts = []
    for top in range(row[0], row[-1] + 1, rows):
        for left in range(col[0], col[-1] + 1, cols):
            window = slice(top, top + rows + 1), slice(left, left + cols + 1)  # pixels at both rims
            measured = usable[window]
            if measured.shape == (rows + 1, cols + 1) and measured.mean() >= MEASURED and measured[[0, 0, -1, -1], [0, -1, 0, -1]].all():
                chart = _fitted(np.where(measured, depth[window], np.nan), (top, left), intrinsic, side, max(UNEVEN[0] / scale, UNEVEN[1]))
                charts += [] if chart is None else [chart]
    stacked = np.array(charts).reshape(-1, side * side, 3)
    return stacked[np.unique(np.linspace(0, len(stacked) - 1, min(CHARTS, len(stacked))).round().astype(int))] if len(stacked) else stacked


def _fitted(depth: Floats, corner: tuple[int, int], intrinsic: Floats, side: int, uneven: float) -> Array | None:
    """Fit a chart (side², 3) to the depths of a window with its first pixel at `corner`; None if they are not a smooth surface."""
    down, across = (np.linspace(-1, 1, count) for count in depth.shape)
    v, u = np.meshgrid(down, across, indexing="ij")
    measured = np.isfinite(depth)
    coefficients = np.linalg.lstsq(_quadric(u[measured], v[measured]), depth[measured], rcond=None)[0]
    if np.sqrt(np.mean((_quadric(u[measured], v[measured]) @ coefficients - depth[measured]) ** 2)) > uneven:
        return None
    y, x = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij"))
    z = _quadric(x, y) @ coefficients
    (top, left), (height, breadth) = corner, depth.shape
    pixels = np.stack([left + 0.5 + (x + 1) / 2 * (breadth - 1), top + 0.5 + (y + 1) / 2 * (height - 1), np.ones_like(x)])
    chart = np.asarray((np.linalg.solve(intrinsic, pixels) * z).T)
    grid = chart.reshape(side, side, 3)
    for axis in (0, 1):
        steps = np.diff(grid, axis=axis)
        if (np.abs(steps[..., 2]) > STEEP * np.linalg.norm(steps[..., :2], axis=-1)).any():
            return None
    return chart


def _quadric(u: Floats, v: Floats) -> Array:
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)

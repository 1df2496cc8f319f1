"""The closed surface on which a field in space is 0: marching cubes, with the field computed near its surface alone."""

from __future__ import annotations

from collections.abc import Callable

import igl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput

Points = NDArray[np.float64]
Field = Callable[[Points], NDArray[np.floating]]

MOST_CELLS = 2**27
"""Of a grid: a gigabyte of values."""
LEAST_SHARE = 1e-3
"""Of the values around the surface: none is nearer to 0, so that no two vertices of the mesh coincide."""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
"""Of a cell, in libigl's order."""


def level_set_mesh(
    field: Field,
    low: Points,
    high: Points,
    spacing: float,
    *,
    slope: float = 1.0,
    halvings: int = 3,
    steep: Points | None = None,
    within: float = 0.0,
) -> tuple[Points, NDArray[np.int64]]:
    """Make the closed mesh that encloses where a field is negative, in a box.

    Parameters
    ----------
    field
        Takes points (N, 3), returns (N,) finite values.
    low, high
        (3,) corners of the box. What is negative is cut off there, or up to 2^halvings cells beyond: the mesh is closed in any case.
    spacing
        Of the grid, in the unit of the box; the mesh's edges are about as long.
    slope
        How much the field changes at most per unit: 1 for a signed distance.
    halvings
        The field is computed on a grid 2^halvings times as wide; this is halved again and again, and the field is computed only at points
        where it can be 0, as slope and neighbours tell. 0 computes it at all points, and needs no slope.
    steep, within
        The field may change faster within this distance of these points (M, 3): there it is computed at each point of the grid.

    Returns
    -------
    Vertices (V, 3) and faces (F, 3), normals outwards, each edge in two faces. Nothing encloses nothing: V and F may be 0.

    Raises
    ------
    InvalidInput
        The box is empty or has more than `MOST_CELLS` cells, or the field is NaN or infinite somewhere.
    """
    low = np.asarray(low, np.float64)
    step = spacing * 2**halvings
    extent = (np.asarray(high) - low) / step
    if not (np.isfinite(extent).all() and (extent > 0).all() and spacing > 0):
        raise InvalidInput(f"a box from {low} to {high} in cells of {spacing} has no inside; its corners differ in each coordinate")
    count = np.ceil(extent)
    if (cells := float(count.prod() * 8.0**halvings)) > MOST_CELLS:
        raise InvalidInput(
            f"a box from {low} to {high} in cells of {spacing} has {cells:.2g} cells, {MOST_CELLS} at most; take larger ones"
        )
    values = np.zeros(count.astype(np.int64) + 1)
    _compute(values, np.ones(values.shape, bool), field, low, step)
    for _ in range(halvings):
        reach, step = np.sqrt(3) * step * slope, step / 2
        values = _halved(values)
        where = np.abs(values) <= reach
        if steep is not None:
            _mark_around(where, np.asarray(steep) - low, step, within)
        _compute(values, where, field, low, step)
    return _march(np.pad(values, 1, constant_values=slope * step), low - step, step)  # closed where the box ends


def _compute(values: NDArray[np.float64], where: NDArray[np.bool_], field: Field, low: Points, step: float) -> None:
    values[where] = found = field(low + step * np.argwhere(where))
    if not np.isfinite(found).all():
        raise InvalidInput(f"a field is NaN or infinite at {np.count_nonzero(~np.isfinite(found))} of {len(found)} points of a grid")


def _mark_around(where: NDArray[np.bool_], places: Points, step: float, within: float) -> None:
    """Set what is within a distance of places (M, 3) along each axis, on a grid that begins at 0; and one more point on each side."""
    reach = int(np.ceil(within / step)) + 1
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    marked = (np.rint(places / step).astype(np.int64)[:, None] + offsets).reshape(-1, 3)
    marked = marked[((marked >= 0) & (marked < where.shape)).all(axis=1)]
    where[tuple(marked.T)] = True


def _halved(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate between neighbours: (2 N - 1) values along each axis, of N."""
    for axis in range(3):
        along = np.moveaxis(values, axis, 0)
        finer = np.repeat(along, 2, axis=0)[:-1]
        finer[1::2] = (along[:-1] + along[1:]) / 2
        values = np.moveaxis(finer, 0, axis)
    return values


def _march(values: NDArray[np.float64], low: Points, step: float) -> tuple[Points, NDArray[np.int64]]:
    """Run marching cubes on the cells that the surface goes through."""
    inside = values < 0
    ends = [slice(None, -1), slice(1, None)]
    corners = np.stack([inside[tuple(ends[end] for end in corner)] for corner in CORNERS])
    cells = np.argwhere(corners.any(axis=0) & ~corners.all(axis=0))  # (N, 3)
    if not len(cells):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    flat = np.ravel_multi_index(tuple(np.moveaxis(cells[:, None] + CORNERS, 2, 0)), values.shape)  # (N, 8)
    used, rows = np.unique(flat, return_inverse=True)
    places = low + step * np.stack(np.unravel_index(used, values.shape), axis=1)
    near = values.ravel()[used]
    least = LEAST_SHARE * np.abs(near).max()
    near = np.where(near < 0, np.minimum(near, -least), np.maximum(near, least))
    vertices, faces, _ = igl.marching_cubes(near, places, rows.reshape(flat.shape), 0.0)
    return vertices, faces

"""The closed surface on which a field in space is 0: marching cubes, with the field computed near its surface alone."""

from collections.abc import Callable

import igl
import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats, Mask

Field = Callable[[Array], Floats]

MAX_CELLS = 2**27  # most cells of a grid, which holds a gigabyte of values
MIN_VALUE_SHARE = 1e-3  # of the largest, that values around the surface have at least: no two vertices coincide
STEEPER = 1.5  # how many times as steep a field may be within a cell as between the cell's corners
CELL_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])  # libigl's


def level_set_mesh(
    field: Field,  # takes points (N, 3), returns (N,) finite values, which change by as much as the points at most: a signed distance
    low: Array,  # (3,)
    high: Array,  # (3,) the other corner of the box
    spacing: float,  # side of a grid cell, in the unit of the box; about the length of the mesh's edges
    *,
    halvings: int = 3,
    dense_points: Array | None = None,  # (M, 3)
    dense_radius: float = 0.0,
    loose_pieces: bool = True,  # keep also negative regions that are neither the largest nor near one of `dense_points`
) -> tuple[Array, NDArray[np.int64]]:  # vertices (V, 3), faces (F, 3)
    """Make the closed mesh, normals outwards, around the part of a box where a field is negative; empty if there is none.

    A negative region is cut off where the box ends, or up to 2^halvings cells beyond, and the mesh closed.

    The field is computed on a grid 2^halvings times as wide. Its cells are then halved, and the field is computed only at points where it
    can be 0 given its neighbours, however thin the region there, and further along the surface. At the last halving it may change no
    faster than `STEEPER` times as between these neighbours: the distances that a network predicts are often flat. With 0 halvings it is
    computed at all points. Within `dense_radius` of `dense_points` it may change faster: there it is computed at each point of the grid.
    """
    low = np.asarray(low, np.float64)
    step = spacing * 2**halvings
    extent = (np.asarray(high) - low) / step
    if not (np.isfinite(extent).all() and (extent > 0).all() and spacing > 0):
        raise InvalidInput(f"a box from {low} to {high} in cells of {spacing} is empty; the second corner must exceed the first")
    count = np.ceil(extent)
    if (cells := float(count.prod() * 8.0**halvings)) > MAX_CELLS:
        box = f"a box from {low} to {high} in cells of {spacing}"
        raise InvalidInput(f"{box} has {cells:.2g} cells, more than {MAX_CELLS}; take larger cells")
    values = np.zeros(count.astype(np.int64) + 1)
    _evaluate(values, np.ones(values.shape, bool), field, low, step)
    for number in range(halvings):
        reach, step, coarse = np.sqrt(3) / 2 * step, step / 2, values  # a cell's middle is as far from its corners
        values = _double_resolution(coarse)
        computed = np.abs(values) <= reach
        if number == halvings - 1:  # with most points; on coarser grids the wider band finds parts where the field is steeper
            at = np.argwhere(computed)
            apart, possible = step * np.sqrt((at % 2).sum(axis=1)), np.ones(len(at), bool)
            steepness = _steepness(coarse, 2 * step)
            for corner in CELL_CORNERS:  # of the coarser cell, edge or face that a point is in the middle of
                ends = tuple((at + corner).T // 2)
                possible &= np.abs(coarse[ends]) <= steepness[ends] * apart
            computed[computed] = possible
        if dense_points is not None:
            _mark_cells_around(computed, np.asarray(dense_points) - low, step, dense_radius)
        _evaluate(values, computed, field, low, step)
        while (missing := _of_corners(np.pad(_crossed_cells(values), 1), np.logical_or) & ~computed).any():
            _evaluate(values, missing, field, low, step)
            computed |= missing
    if not loose_pieces:
        region, regions = scipy.ndimage.label(values < 0)  # 0 where values are positive
        size = np.bincount(region.ravel())
        size[0] = 0
        anchors = np.zeros(values.shape, bool)
        if dense_points is not None:
            _mark_cells_around(anchors, np.asarray(dense_points) - low, step, dense_radius)
        kept = np.bincount(region[anchors], minlength=regions + 1) > 0
        kept[0] = kept[size.argmax()] = True
        values[~kept[region]] *= -1
    return _marching_cubes(np.pad(values, 1, constant_values=step), low - step, step)  # closed where the box ends


def _evaluate(values: Array, where: Mask, field: Field, low: Array, step: float) -> None:
    if not where.any():
        return
    values[where] = computed = field(low + step * np.argwhere(where))
    if not np.isfinite(computed).all():
        raise InvalidInput(f"a field is NaN or infinite at {np.count_nonzero(~np.isfinite(computed))} of {len(computed)} points of a grid")


def _mark_cells_around(where: Mask, positions: Array, step: float, radius: float) -> None:
    """Mark the points of a grid from 0 on within a distance of positions (M, 3) along each axis, and one more point on each side."""
    reach = int(np.ceil(radius / step)) + 1
    for position in np.unique(np.rint(positions / step).astype(np.int64), axis=0):
        first, last = np.maximum(position - reach, 0), np.maximum(position + reach + 1, 0)
        where[tuple(map(slice, first, last))] = True


def _steepness(values: Array, step: float) -> Array:
    """Bound how much the field changes per length around each point of a grid (X, Y, Z), by the changes to its neighbours; at most 1."""
    squares = np.zeros(values.shape)
    for axis in range(3):
        changes = np.abs(np.diff(values, axis=axis, prepend=np.nan, append=np.nan)) / step
        along = np.moveaxis(changes, axis, 0)
        squares += np.moveaxis(np.fmax(along[:-1], along[1:]), 0, axis) ** 2
    return np.minimum(STEEPER * np.sqrt(squares), 1)


def _double_resolution(values: Array) -> Array:
    """Interpolate between neighbours: (2 N - 1) values along each axis, of N."""
    for axis in range(3):
        along = np.moveaxis(values, axis, 0)
        finer = np.repeat(along, 2, axis=0)[:-1]
        finer[1::2] = (along[:-1] + along[1:]) / 2
        values = np.moveaxis(finer, 0, axis)
    return values


def _crossed_cells(values: Array) -> Mask:
    inside = values < 0
    return np.asarray(_of_corners(inside, np.logical_or) & ~_of_corners(inside, np.logical_and))


def _of_corners(marks: Mask, combine: Callable[[Mask, Mask], Mask]) -> Mask:
    """Combine the marks at the corners of each cell: (N - 1) values along each axis, of N."""
    for axis in range(3):
        along = np.moveaxis(marks, axis, 0)
        marks = np.moveaxis(combine(along[:-1], along[1:]), 0, axis)
    return marks


def _marching_cubes(values: Array, low: Array, step: float) -> tuple[Array, NDArray[np.int64]]:
    cells = np.argwhere(_crossed_cells(values))  # (N, 3)
    if not len(cells):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    flat = np.ravel_multi_index(tuple(np.moveaxis(cells[:, None] + CELL_CORNERS, 2, 0)), values.shape)  # (N, 8)
    used, rows = np.unique(flat, return_inverse=True)
    positions = low + step * np.stack(np.unravel_index(used, values.shape), axis=1)
    corner_values = values.ravel()[used]
    smallest = MIN_VALUE_SHARE * np.abs(corner_values).max()
    corner_values = np.where(corner_values < 0, np.minimum(corner_values, -smallest), np.maximum(corner_values, smallest))
    vertices, faces, _ = igl.marching_cubes(corner_values, positions, rows.reshape(flat.shape), 0.0)
    return vertices, faces

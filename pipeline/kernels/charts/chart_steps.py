"""Compiled steps of a touch chart: its loss, the gradient, Adam, and the grid that finds nearest points. In sensor widths, float64.

Points of a touch lie side by side: few cells of a grid over x and y hold the neighbours of a point, some ten times faster than a k-d tree,
and built in a tenth of the time. Other clouds take longer, and give the same neighbours.

All of it is one file: numba keeps machine code by the file of a function, and does not see that one in another file has changed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled

BETAS = 0.9, 0.999  # Adam's decays of the mean gradient and of its square, as published: the supplement names none
EPSILON = 1e-8  # what Adam adds to the root of the mean square, as published


class ChartState(NamedTuple):
    """A chart that is being fitted; steps change the arrays."""

    vertices: Array  # (V, 3)
    mean: Array  # (V, 3) Adam's mean gradient
    square: Array  # (V, 3) Adam's mean squared gradient
    faces: NDArray[np.int64]  # (F, 3)


@compiled
def chart_area(chart: ChartState) -> float:
    """Compute the area of a chart."""
    return float(_cumulative_areas(chart)[-1] / 2)


@compiled
def chamfer_and_gradient(
    chart: ChartState,  # with an area above 0
    uniform: Array,  # (n, 3) in [0, 1], which `map_to_surface` maps to the chart
    cloud: Array,  # (m, 3) points whose nearest samples are searched
    target: "PlanarGrid",  # the cloud, or points that represent it, of which each sample finds the nearest
) -> tuple[float, Array]:  # distance, gradient (V, 3)
    """Compute the Chamfer distance between samples of a chart and a cloud, and its gradient with neighbours and samples held fixed."""
    count, vertices, faces = len(uniform), chart.vertices, chart.faces
    areas = _cumulative_areas(chart)
    chosen, weights, samples = np.empty(count, np.int64), np.empty((count, 3)), np.empty((count, 3))
    for i in range(count):
        chosen[i] = _first_above(areas, uniform[i, 0] * areas[-1])
        root, along = np.sqrt(uniform[i, 1]), uniform[i, 2]
        weights[i, 0], weights[i, 1], weights[i, 2] = 1 - root, root * (1 - along), root * along
        a, b, c = faces[chosen[i], 0], faces[chosen[i], 1], faces[chosen[i], 2]
        for axis in range(3):
            samples[i, axis] = weights[i, 0] * vertices[a, axis] + weights[i, 1] * vertices[b, axis] + weights[i, 2] * vertices[c, axis]
    to_cloud, to_chart = 0.0, 0.0
    pulls = np.empty((count, 3))  # the gradient of each sample
    slots = nearest_in(target, samples)
    for i in range(count):
        for axis in range(3):
            difference = samples[i, axis] - target.points[slots[i], axis]
            to_cloud += difference * difference
            pulls[i, axis] = 2 * difference / count
    sampled = planar_grid(samples)
    slots = nearest_in(sampled, cloud)
    for i in range(len(cloud)):
        for axis in range(3):
            difference = sampled.points[slots[i], axis] - cloud[i, axis]
            to_chart += difference * difference
            pulls[sampled.numbers[slots[i]], axis] += 2 * difference / len(cloud)
    gradient = np.zeros_like(vertices)
    for i in range(count):
        for corner in range(3):
            vertex, weight = faces[chosen[i], corner], weights[i, corner]
            for axis in range(3):
                gradient[vertex, axis] += weight * pulls[i, axis]
    return to_cloud / count + to_chart / len(cloud), gradient


@compiled
def descend(chart: ChartState, gradient: Array, step: int, rate: float) -> None:
    """Take Adam's step number `step`, from 1 (Kingma and Ba, 2015, algorithm 1)."""
    for vertex in range(len(chart.vertices)):
        for axis in range(3):
            slope = gradient[vertex, axis]
            mean = BETAS[0] * chart.mean[vertex, axis] + (1 - BETAS[0]) * slope
            square = BETAS[1] * chart.square[vertex, axis] + (1 - BETAS[1]) * slope * slope
            chart.mean[vertex, axis], chart.square[vertex, axis] = mean, square
            root = np.sqrt(square / (1 - BETAS[1] ** step)) + EPSILON
            chart.vertices[vertex, axis] -= rate * (mean / (1 - BETAS[0] ** step)) / root


@compiled
def take_steps(
    chart: ChartState,  # is changed
    uniform: Array,  # (k, n, 3) in [0, 1], of each step
    parts: Array,  # (P, m, 3) parts of the cloud, which steps take in turn
    targets: "tuple[PlanarGrid, PlanarGrid]",  # searched by samples until a loss is below `near_loss`, and then: part, whole
    near_loss: float,  # +inf for a chart that is near already
    steps: int,  # taken before
    rate: float,  # Adam's
) -> Array:  # (k,) losses of the steps, or of fewer
    """Take steps, each with other samples and points; stop before a step if no area is left."""
    losses, is_near = np.empty(len(uniform)), near_loss == np.inf
    for i in range(len(uniform)):
        if not chart_area(chart) > 0:
            return losses[:i]
        target = targets[1] if is_near else targets[0]
        losses[i], gradient = chamfer_and_gradient(chart, uniform[i], parts[(steps + i) % len(parts)], target)
        is_near = is_near or losses[i] < near_loss
        descend(chart, gradient, steps + i + 1, rate)
    return losses


@compiled
def _cumulative_areas(chart: ChartState) -> Array:
    """Sum up twice the areas of the faces, face after face: (F,); by components, as `doubled_areas`."""
    vertices, faces, areas, total = chart.vertices, chart.faces, np.empty(len(chart.faces)), 0.0
    for i in range(len(faces)):
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        x, y, z, u, v, w = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
        total += np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)
        areas[i] = total
    return areas


@compiled
def _first_above(cumulative: Array, value: float) -> int:
    """Find the first of increasing numbers that exceeds a value; if none does, by rounding, the first that equals the last one."""
    low, high = 0, len(cumulative) - 1
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] > value or cumulative[middle] == cumulative[-1]:
            high = middle
        else:
            low = middle + 1
    return low


class PlanarGrid(NamedTuple):
    """Points, sorted by the cell of a grid over x and y."""

    points: Array  # (n, 3) cell by cell, row by row
    numbers: NDArray[np.int64]  # (n,) number of each in the cloud
    starts: NDArray[np.int64]  # (cells + 1,) where each cell's points begin
    x: float  # corner of the first cell
    y: float
    side: float  # of a cell
    columns: int  # cells along x
    rows: int  # cells along y


@compiled
def planar_grid(points: Array) -> PlanarGrid:
    """Sort points (n, 3), n at least 1, finite, into the cells of a grid around them."""
    count = len(points)
    x, y, right, top = np.inf, np.inf, -np.inf, -np.inf
    for i in range(count):
        x, right = min(x, points[i, 0]), max(right, points[i, 0])
        y, top = min(y, points[i, 1]), max(top, points[i, 1])
    width, height = right - x, top - y
    side = max(np.sqrt(2 * width / count) * np.sqrt(height), 2 * max(width, height) / count)
    if not side > 0:  # all at one position
        side = 1.0
    columns, rows = int(width / side) + 1, int(height / side) + 1
    cells, starts = np.empty(count, np.int64), np.zeros(columns * rows + 1, np.int64)
    for i in range(count):
        cells[i] = _cell(points[i, 1], y, side, rows) * columns + _cell(points[i, 0], x, side, columns)
        starts[cells[i] + 1] += 1
    for cell in range(columns * rows):
        starts[cell + 1] += starts[cell]
    free = starts.copy()
    ordered, numbers = np.empty((count, 3)), np.empty(count, np.int64)
    for i in range(count):
        slot = free[cells[i]]
        free[cells[i]] = slot + 1
        numbers[slot] = i
        for axis in range(3):
            ordered[slot, axis] = points[i, axis]
    return PlanarGrid(ordered, numbers, starts, x, y, side, columns, rows)


@compiled
def nearest_in(grid: PlanarGrid, queries: Array) -> NDArray[np.int64]:  # (m,) slots in `grid.points`
    """Find the nearest point to each of `queries` (m, 3); the nearest of the nine cells around it bounds which cells are searched."""
    points, starts, columns, rows, side = grid.points, grid.starts, grid.columns, grid.rows, grid.side
    slots = np.empty(len(queries), np.int64)
    for query in range(len(queries)):
        x, y, z = queries[query, 0], queries[query, 1], queries[query, 2]
        column, row = _cell(x, grid.x, side, columns), _cell(y, grid.y, side, rows)
        left, right, low, high = max(column - 1, 0), min(column + 1, columns - 1), max(row - 1, 0), min(row + 1, rows - 1)
        slot = min(starts[row * columns + column], len(points) - 1)  # any, if all nine are empty
        least = (points[slot, 0] - x) ** 2 + (points[slot, 1] - y) ** 2 + (points[slot, 2] - z) ** 2
        slot, least = _nearer(points, starts, columns, left, right, low, high, x, y, z, slot, least)
        reach = np.sqrt(least)
        leftmost, rightmost = _cell(x - reach, grid.x, side, columns), _cell(x + reach, grid.x, side, columns)
        lowest, highest = _cell(y - reach, grid.y, side, rows), _cell(y + reach, grid.y, side, rows)
        if leftmost < left or rightmost > right or lowest < low or highest > high:
            slot, least = _nearer(points, starts, columns, leftmost, rightmost, lowest, highest, x, y, z, slot, least)
        slots[query] = slot
    return slots


@compiled
def _cell(coordinate: float, start: float, side: float, cells: int) -> int:
    """Find the cell of a coordinate along an axis; outside the grid, the outermost."""
    return int(min(max((coordinate - start) / side, 0.0), cells - 1.0))


@compiled
def _nearer(
    points: Array, starts: NDArray[np.int64], columns: int, left: int, right: int, low: int, high: int,
    x: float, y: float, z: float, slot: int, least: float,
) -> tuple[int, float]:  # fmt: skip
    """Search a block of cells for a point nearer than that at `slot`; return the nearest one's slot and its squared distance.

    A function of plain arrays: written out twice, or given the grid, it is compiled to half the speed.
    """
    for row in range(low, high + 1):
        for i in range(starts[row * columns + left], starts[row * columns + right + 1]):
            squared = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 + (points[i, 2] - z) ** 2
            if squared < least:
                slot, least = i, squared
    return slot, least

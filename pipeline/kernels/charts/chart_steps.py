"""Compiled steps of a touch chart: its loss, the gradient, Adam. Lengths are sensor widths, in float64."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.charts.planar_grid import PlanarGrid, nearest_in, planar_grid
from pipeline.kernels.compiled import compiled

BETAS = 0.9, 0.999
"""Adam's decays of the mean gradient and of its square, as published: the supplement names none."""
EPSILON = 1e-8
"""What Adam adds to the root of the mean square, as published."""


class ChartState(NamedTuple):
    """A chart that is being fitted; steps change the arrays.

    Attributes
    ----------
    vertices
        (V, 3).
    mean, square
        (V, 3) Adam's mean gradient and mean squared gradient.
    faces
        (F, 3) int64.
    """

    vertices: NDArray[np.float64]
    mean: NDArray[np.float64]
    square: NDArray[np.float64]
    faces: NDArray[np.int64]


@compiled
def chart_area(chart: ChartState) -> float:
    """Compute the area of a chart."""
    return float(_cumulative_areas(chart)[-1] / 2)


@compiled
def chamfer_and_gradient(
    chart: ChartState, uniform: NDArray[np.float64], cloud: NDArray[np.float64], target: PlanarGrid
) -> tuple[float, NDArray[np.float64]]:
    """Compute the Chamfer distance between samples of a chart and a cloud, and its gradient.

    Parameters
    ----------
    chart
        With an area above 0.
    uniform
        (n, 3) in [0, 1], which `map_to_surface` maps to the chart.
    cloud
        (m, 3) points whose nearest samples are found.
    target
        The cloud, or points that stand for it, of which each sample finds the nearest.

    Returns
    -------
    The distance, and its gradient (V, 3) with the neighbours and the samples' places on the chart held fixed.
    """
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
    places = nearest_in(target, samples)
    for i in range(count):
        for axis in range(3):
            difference = samples[i, axis] - target.points[places[i], axis]
            to_cloud += difference * difference
            pulls[i, axis] = 2 * difference / count
    sampled = planar_grid(samples)
    places = nearest_in(sampled, cloud)
    for i in range(len(cloud)):
        for axis in range(3):
            difference = sampled.points[places[i], axis] - cloud[i, axis]
            to_chart += difference * difference
            pulls[sampled.numbers[places[i]], axis] += 2 * difference / len(cloud)
    gradient = np.zeros_like(vertices)
    for i in range(count):
        for corner in range(3):
            vertex, weight = faces[chosen[i], corner], weights[i, corner]
            for axis in range(3):
                gradient[vertex, axis] += weight * pulls[i, axis]
    return to_cloud / count + to_chart / len(cloud), gradient


@compiled
def descend(chart: ChartState, gradient: NDArray[np.float64], step: int, rate: float) -> None:
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
    chart: ChartState,
    uniform: NDArray[np.float64],
    parts: NDArray[np.float64],
    targets: tuple[PlanarGrid, PlanarGrid],
    near_loss: float,
    steps: int,
    rate: float,
) -> NDArray[np.float64]:
    """Take steps, each with other samples and points; stop before a step if no area is left.

    Parameters
    ----------
    chart
        Is changed.
    uniform
        (k, n, 3) in [0, 1], of each step.
    parts
        (P, m, 3) parts of the cloud, which steps take in turn.
    targets
        The first part and the whole cloud. Samples find their nearest in the first part until a loss is below `near_loss`, then in all.
    near_loss
        +inf for a chart that is near already.
    steps
        Taken before.
    rate
        Adam's.

    Returns
    -------
    (k,) losses of the steps, or of fewer.
    """
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
def _cumulative_areas(chart: ChartState) -> NDArray[np.float64]:
    """Sum up twice the areas of the faces, face after face: (F,); by components, as `doubled_areas`."""
    vertices, faces, areas, total = chart.vertices, chart.faces, np.empty(len(chart.faces)), 0.0
    for i in range(len(faces)):
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        x, y, z, u, v, w = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
        total += np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)
        areas[i] = total
    return areas


@compiled
def _first_above(cumulative: NDArray[np.float64], value: float) -> int:
    """Find the first of increasing numbers that exceeds a value; if none does, by rounding, the first that equals the last one."""
    low, high = 0, len(cumulative) - 1
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] > value or cumulative[middle] == cumulative[-1]:
            high = middle
        else:
            low = middle + 1
    return low

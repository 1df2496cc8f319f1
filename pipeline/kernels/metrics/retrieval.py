"""Similarity of shapes and of silhouettes, for the retrieval baselines."""

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.kernels.arrays import Array, Array32, Integers, Mask
from pipeline.kernels.metrics.nearest_points import Cloud

SITES = 16  # per side of the grid around many clouds, by which most are excluded at once
ROUNDING = 1 - 1e-9  # factor that keeps a bound below its distance despite rounding


def mean_squared_distance(cloud: Cloud, query: Cloud) -> float:
    """Compute the mean squared distance from the points of a query to the nearest of a cloud's, in the square of their unit."""
    return float(cloud.nearest(query)[0].mean())


class SearchedClouds:
    """Clouds among which the nearest to a query is searched, and their distances from a grid of sites around them."""

    def __init__(self, clouds: Sequence[Cloud]) -> None:
        self.clouds = clouds
        low, high = (edge([edge(cloud.points, axis=0) for cloud in clouds], axis=0) for edge in (np.min, np.max))
        self.sites = Cloud(np.stack(np.meshgrid(*np.linspace(low, high, SITES).T), axis=-1).reshape(-1, 3))
        self._gaps = np.stack([_apart(cloud, self.sites)[0] for cloud in clouds])  # (cloud, site) to the nearest point
        # of each cloud's points, the distance from the nearest site, and its number; and the first of each cloud
        self._near, self._site = (np.concatenate(parts) for parts in zip(*(_apart(self.sites, cloud) for cloud in clouds), strict=True))
        self._counts = np.array([len(cloud.points) for cloud in clouds])

    def bounds(self, query: Cloud, *, both: bool) -> Array:  # (cloud,)
        """Compute lower bounds of a query's distances, see `nearest_cloud`, by the triangle inequality over the nearest sites."""
        apart, site = _apart(self.sites, query)
        # cloud by cloud: touches have tens of thousands of points
        bounds = np.array([np.square(np.maximum(gaps[site] - apart, 0.0)).mean() for gaps in self._gaps])
        if both:
            gaps = _apart(query, self.sites)[0]
            squares = np.square(np.maximum(gaps[self._site] - self._near, 0.0))
            bounds += np.add.reduceat(squares, np.cumsum(self._counts) - self._counts) / self._counts
        return np.asarray(bounds * ROUNDING)


def _apart(cloud: Cloud, query: Cloud) -> tuple[Array, Integers]:
    """Find the distance from each point of a query to the nearest of a cloud's, and its number."""
    squared, nearest = cloud.nearest(query)
    return np.sqrt(squared), nearest


def nearest_cloud(
    query: Cloud,
    searched: SearchedClouds,  # in the query's frame
    *,
    both: bool,  # the Chamfer distance, or the mean squared distance from the query's points alone
    below: float = np.inf,  # only a smaller distance counts
) -> tuple[float, int] | None:  # distance, in the square of the clouds' unit, and number of the first cloud that has it
    """Find the cloud nearest to a query, as a comparison with all would, to the bit: those of the least bounds are compared first."""
    bounds, nearest = searched.bounds(query, both=both), (below, -1)
    for number in np.argsort(bounds, kind="stable").tolist():
        if bounds[number] >= nearest[0]:
            break
        cloud = searched.clouds[number]
        distance = mean_squared_distance(cloud, query) + (mean_squared_distance(query, cloud) if both else 0.0)
        nearest = min(nearest, (distance, number))
    return None if nearest[1] < 0 else nearest


def chamfer_matrix(clouds: Sequence[Cloud], advance: Callable[[], None] = lambda: None) -> Array:  # (A, A)
    """Compute the Chamfer distance of each pair of clouds, in their unit squared; `advance` is called after each row."""
    matrix = np.zeros((len(clouds), len(clouds)))
    for row, cloud in enumerate(clouds):
        for column, other in enumerate(clouds[:row]):
            distance = mean_squared_distance(other, cloud) + mean_squared_distance(cloud, other)
            matrix[row, column] = matrix[column, row] = distance
        advance()
    return matrix


def silhouette_overlap(masks: Mask, others: Mask) -> Array32:  # (A, B)
    """Compute the intersection over union of each of `masks` (A, P pixels) with each of `others` (B, P); 0 where both are empty."""
    first, second = masks.astype(np.float32), others.astype(np.float32)
    intersection = first @ second.T
    union = first.sum(axis=1)[:, None] + second.sum(axis=1) - intersection
    return np.asarray(intersection / np.maximum(union, 1), np.float32)

"""Similarity of shapes and of silhouettes, for the retrieval baselines."""

from collections.abc import Sequence
from heapq import heapify, heappop, heapreplace

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array, Array32, Integers, Mask
from pipeline.kernels.metrics.nearest_points import Cloud

SITES = 16  # per side of the grid around many clouds, by which most are excluded at once
ROUNDING = 1 - 1e-9  # factor that keeps a bound below its distance despite rounding


def mean_squared_distance(cloud: Cloud, query: Cloud) -> float:
    """Compute the mean squared distance from the points of a query to the nearest of a cloud's, in the square of their unit."""
    return float(cloud.nearest(query)[0].mean())


def chamfer_distance(cloud: Cloud, other: Cloud) -> float:
    """Compute the Chamfer distance of two clouds, in the square of their unit."""
    return mean_squared_distance(other, cloud) + mean_squared_distance(cloud, other)


class SearchedClouds:
    """Clouds of N points each, among which the nearest to a query is searched, and their distances from a grid of sites around them."""

    def __init__(self, clouds: Sequence[Cloud]) -> None:
        self.clouds = clouds
        low, high = (edge([edge(cloud.points, axis=0) for cloud in clouds], axis=0) for edge in (np.min, np.max))
        self.sites = Cloud(np.stack(np.meshgrid(*np.linspace(low, high, SITES).T), axis=-1).reshape(-1, 3))
        self._gaps = np.stack([_apart(cloud, self.sites)[0] for cloud in clouds])  # (cloud, site) to the nearest point
        # of each cloud's points, (cloud, N), the distance from the nearest site, and its number
        self._near, self._site = (np.stack(parts) for parts in zip(*(_apart(self.sites, cloud) for cloud in clouds), strict=True))

    def bounds(self, query: Cloud, *, both: bool) -> Array:  # (cloud,)
        """Compute lower bounds of a query's distances, see `nearest_cloud`, by the triangle inequality over the nearest sites."""
        means, shares, spread = (query, np.full(len(query.points), 1 / len(query.points)), np.zeros(1)) if both else query.summary
        apart, site = _apart(self.sites, means)
        bounds = np.square(np.maximum(self._gaps[:, site] - (apart + spread), 0)) @ shares
        if both:
            bounds += np.square(np.maximum(_apart(query, self.sites)[0][self._site] - self._near, 0)).mean(axis=1)
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
    """Find the cloud nearest to a query, as a comparison with all would, to the bit: those of the least bounds are compared first.

    The query's points alone may be tens of thousands, of touches: a cloud is compared with their summary before it is with them.
    """
    nearest = (below, -1)
    waiting = [(bound, number, both) for number, bound in enumerate(searched.bounds(query, both=both).tolist())]
    heapify(waiting)
    while waiting and waiting[0][0] < nearest[0]:
        _, number, is_last_bound = waiting[0]
        cloud = searched.clouds[number]
        if is_last_bound:
            heappop(waiting)
            nearest = min(nearest, (chamfer_distance(cloud, query) if both else mean_squared_distance(cloud, query), number))
        else:
            means, shares, spread = query.summary
            bound = np.square(np.maximum(_apart(cloud, means)[0] - spread, 0)) @ shares
            heapreplace(waiting, (float(bound * ROUNDING), number, True))
    return None if nearest[1] < 0 else nearest


def typical_cloud(searched: SearchedClouds) -> int:
    """Find the cloud of the least mean Chamfer distance to all of them, the first if several have it."""
    every = np.stack([searched.bounds(cloud, both=True) for cloud in searched.clouds])
    nearest = (np.inf, -1)  # sum of the distances, and number
    for number in np.argsort(every.sum(axis=1), kind="stable").tolist():
        distances = every[number]  # bounds, which become distances one after the other
        for at, other in enumerate(searched.clouds):
            if distances.sum() > nearest[0]:
                break
            distances[at] = chamfer_distance(searched.clouds[number], other)
        nearest = min(nearest, (float(distances.sum()), number))
    return nearest[1]


def packed_masks(masks: Mask) -> NDArray[np.uint64]:  # (…, words)
    """Pack masks (…, pixels) 64 pixels to a word, the last word filled up with 0."""
    octets = np.packbits(masks, axis=-1)
    return np.pad(octets, [(0, 0)] * (octets.ndim - 1) + [(0, -octets.shape[-1] % 8)]).view(np.uint64)


def silhouette_overlap(mask: NDArray[np.uint64], others: NDArray[np.uint64]) -> Array32:  # (B,)
    """Compute the intersection over union of a packed mask (words,) with each of `others` (B, words); 0 where both are empty."""
    intersection, union = (np.bitwise_count(words).sum(axis=1) for words in (mask & others, mask | others))
    return np.asarray(intersection / np.maximum(union, 1), np.float32)

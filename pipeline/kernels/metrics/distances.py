"""How far a reconstruction is from the true surface: Chamfer distance and F1 on points drawn from both, in float64."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FAR = 1e150
"""m; beyond it a squared distance is no float64."""
TABLE_3_FACTOR = 9000.0
"""Table 3's values are consistent with this multiple of the Chamfer distance in m² (anything from 5,000 to 12,000 would be)."""


class Cloud:
    """Points (M, 3) with their search tree, built once: for a truth that many predictions are held against.

    Raises
    ------
    ValueError
        The cloud is empty, is not (…, 3), or holds NaN, infinity or coordinates beyond 1e150.
    """

    def __init__(self, points: NDArray[np.floating]) -> None:
        self.points = _cloud("points", points)
        self.tree = cKDTree(self.points)


def nearest_squared(query: NDArray[np.floating], points: NDArray[np.floating] | Cloud) -> NDArray[np.float64]:
    """Squared distance of every query point (N, 3) to the nearest of `points` (M, 3): (N,), the input's unit squared.

    Raises
    ------
    ValueError
        A cloud is empty, is not (…, 3), or holds NaN, infinity or coordinates beyond 1e150.
    """
    query, cloud = _cloud("query", query), points if isinstance(points, Cloud) else Cloud(points)
    nearest = cloud.tree.query(query)[1]
    return np.asarray(np.square(query - cloud.points[nearest]).sum(axis=1))


@dataclass(frozen=True)
class Distances:
    """Squared nearest distances between a predicted cloud and the true one, m².

    Attributes
    ----------
    predicted
        (P,) from every predicted point to the truth.
    truth
        (T,) from every true point to the prediction.
    """

    predicted: NDArray[np.float64]
    truth: NDArray[np.float64]

    @property
    def chamfer(self) -> float:
        """Chamfer distance: the mean squared nearest distance, both directions summed."""
        return float(self.predicted.mean() + self.truth.mean())

    def precision_recall(self, tau: float, scale: float = 1.0) -> tuple[float, float]:
        """Shares of predicted and of true points whose squared distance, the clouds scaled by `scale`, is at most `tau`.

        Each is a share of its own cloud's points: precision of the predicted ones, recall of the true ones. A `ValueError` where
        `tau` or `scale` is no number, `tau` is negative, or `scale` not above 0.
        """
        if not (tau >= 0 and 0 < scale < np.inf):
            raise ValueError(f"squared distance {tau}, scale {scale}: the distance is at least 0, the scale above it and finite")
        precision, recall = (float(np.mean(squared * scale**2 <= tau)) for squared in (self.predicted, self.truth))
        return precision, recall

    def f1(self, tau: float, scale: float = 1.0) -> float:
        """Harmonic mean of precision and recall at the squared distance `tau` (Table 4's protocol), 0 where both are 0."""
        precision, recall = self.precision_recall(tau, scale)
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def distances(predicted: NDArray[np.floating], truth: NDArray[np.floating] | Cloud) -> Distances:
    """The squared nearest distances between a predicted (P, 3) and a true (T, 3) cloud, both ways; errors as `nearest_squared`."""
    known = truth if isinstance(truth, Cloud) else Cloud(truth)
    return Distances(nearest_squared(predicted, known), nearest_squared(known.points, predicted))


def sampling_floor(area: float, count: int) -> float:
    """Chamfer distance between two samplings of one surface, 2A / (π n): what a perfect reconstruction measures.

    For points scattered at random over a plane, n on an area A, the squared distance to the nearest has mean A / (π n).
    """
    if not 0 <= area < np.inf or count < 1:
        raise ValueError(
            f"an area of {area} m² with {count} points has no sampling floor: the area is finite and at least 0, the points at least 1"
        )
    return 2 * area / (np.pi * count)


def sampled_area(points: NDArray[np.floating]) -> float:
    """The area of the surface from which `points` (N, 3) were drawn area-uniformly, unit squared; accurate to 1/√N.

    It is the area over which the points, each against the others, would lie as far apart as they do. Where two sides of a
    surface are nearer than neighbouring points it counts them once, as a nearest distance does: what `sampling_floor` asks for.
    """
    points = _cloud("points", points)
    if len(points) < 2:
        raise ValueError("one point says nothing of an area: two at least")
    squared = cKDTree(points).query(points, k=2)[0][:, 1] ** 2
    return float(np.pi * (len(points) - 1) * squared.mean())


def _cloud(name: str, points: NDArray[np.floating]) -> NDArray[np.float64]:
    cloud: NDArray[np.float64] = np.asarray(points, np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise ValueError(f"{name} has shape {cloud.shape}; a cloud is (number, 3)")
    if not len(cloud):
        raise ValueError(f"{name} is an empty cloud: nothing has a nearest point in it; check what it was drawn from")
    near = (np.abs(cloud) <= FAR).all(axis=1)  # not where there is a NaN
    if not near.all():
        raise ValueError(f"{name} holds {np.count_nonzero(~near)} points with NaN, infinity or coordinates beyond {FAR:g}")
    return cloud

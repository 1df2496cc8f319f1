"""Similarity of shapes and of silhouettes, for the retrieval baselines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


def mean_squared_distance(tree: cKDTree, points: NDArray[np.floating]) -> float:
    """Compute the mean squared distance from points (N, 3) to the nearest of a tree's, in the square of their unit."""
    return float(np.square(tree.query(points)[0]).mean())


def chamfer_matrix(clouds: Sequence[NDArray[np.floating]], others: Sequence[NDArray[np.floating]]) -> NDArray[np.float64]:
    """Compute the Chamfer distance of each cloud to each of the others.

    Parameters
    ----------
    clouds, others
        A and B clouds, (N, 3) each, one frame.

    Returns
    -------
    (A, B) float64, mean squared nearest distances, both directions summed, in the square of the clouds' unit.
    """
    trees = [cKDTree(other) for other in others]
    return np.array(
        [
            [mean_squared_distance(tree, cloud) + mean_squared_distance(own, other) for other, tree in zip(others, trees, strict=True)]
            for cloud, own in zip(clouds, map(cKDTree, clouds), strict=True)
        ]
    )


def silhouette_overlap(masks: NDArray[np.bool_], others: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Compute how much silhouettes have in common.

    Parameters
    ----------
    masks, others
        (A, P) and (B, P), whether each of P pixels is covered.

    Returns
    -------
    (A, B) float32: intersection over union of each of `masks` with each of `others`; 0 where both are empty.
    """
    first, second = masks.astype(np.float32), others.astype(np.float32)
    both = first @ second.T
    either = first.sum(axis=1)[:, None] + second.sum(axis=1) - both
    return np.asarray(both / np.maximum(either, 1), np.float32)

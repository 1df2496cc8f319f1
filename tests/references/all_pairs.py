"""Distances of a cloud to others, slowly: every point against every point."""

from collections.abc import Sequence

import numpy as np


def squared_distance_to_all(cloud: np.ndarray, others: Sequence[np.ndarray]) -> list[float]:
    """Mean squared distance from each point of a cloud to the nearest of each other's."""
    return [float(((cloud[:, None] - other[None]) ** 2).sum(axis=2).min(axis=1).mean()) for other in others]


def chamfer_to_all(cloud: np.ndarray, others: Sequence[np.ndarray]) -> list[float]:
    """Chamfer distance to each other cloud, both directions summed."""
    back = [squared_distance_to_all(other, [cloud])[0] for other in others]
    return [there + here for there, here in zip(squared_distance_to_all(cloud, others), back, strict=True)]

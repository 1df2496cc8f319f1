"""Signed distance to a box, in closed form."""

import numpy as np


def box_distance(points: np.ndarray, sides: np.ndarray, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(N,) distance of points (N, 3) from a box along the axes, negative inside."""
    beyond = np.abs(points - np.array(centre)) - np.asarray(sides) / 2
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)

"""Escaping rays, counted one direction after the other in float64."""

import numpy as np


def count_escapes(triangles: np.ndarray, points: np.ndarray, directions: np.ndarray, offset: float) -> np.ndarray:
    """(N,) numbers of rays from `offset` off `points` (N, 3) that hit no triangle (F, 3, 3) (Möller & Trumbore)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    free = np.zeros(len(points), int)
    for direction in directions:
        cross = np.cross(direction, c - a)
        determinant = ((b - a) * cross).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            start = (points + offset * direction)[:, None] - a
            u = (start * cross).sum(axis=2) / determinant
            turned = np.cross(start, b - a)
            v = (turned @ direction) / determinant
            t = (turned * (c - a)).sum(axis=2) / determinant
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        free += ~hit.any(axis=1)
    return free

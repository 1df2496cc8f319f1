"""Gaps between oriented boxes by the separating axis test (Gottschalk et al., OBBTree, 1996)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PARALLEL = 1e-6
"""Squared sine below which two edges count as parallel: their cross product is no axis, and the faces' axes are enough."""


def box_gap(
    frames_a: NDArray[np.float64], half_a: NDArray[np.float64], frames_b: NDArray[np.float64], half_b: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the largest gap between two boxes along any of the 15 candidate axes.

    Parameters
    ----------
    frames_a, frames_b
        (..., 4, 4) poses of the boxes' centres, m.
    half_a, half_b
        (..., 3) half extents, m. All four broadcast.

    Returns
    -------
    (...) float64, m: a lower bound of the distance of boxes that are apart; of boxes that overlap, minus their least overlap.
    """
    turn_a, turn_b = frames_a[..., :3, :3], frames_b[..., :3, :3]
    offset = frames_b[..., :3, 3] - frames_a[..., :3, 3]
    rotation = np.einsum("...ji,...jk->...ik", turn_a, turn_b)
    size = np.abs(rotation)
    shift = np.einsum("...ji,...j->...i", turn_a, offset)  # in a's axes
    gap_a = np.abs(shift) - half_a - np.einsum("...ij,...j->...i", size, half_b)
    shift_b = np.einsum("...ji,...j->...i", rotation, shift)
    gap_b = np.abs(shift_b) - half_b - np.einsum("...ij,...i->...j", size, half_a)
    gap: NDArray[np.float64] = np.maximum(gap_a.max(axis=-1), gap_b.max(axis=-1))
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            n, o = (j + 1) % 3, (j + 2) % 3
            distance = np.abs(shift[..., m] * rotation[..., k, j] - shift[..., k] * rotation[..., m, j])
            extent = half_a[..., k] * size[..., m, j] + half_a[..., m] * size[..., k, j]
            extent = extent + half_b[..., n] * size[..., i, o] + half_b[..., o] * size[..., i, n]
            sine2 = 1 - rotation[..., i, j] ** 2
            along = (distance - extent) / np.sqrt(np.maximum(sine2, PARALLEL))
            gap = np.where(sine2 > PARALLEL, np.maximum(gap, along), gap)
    return gap

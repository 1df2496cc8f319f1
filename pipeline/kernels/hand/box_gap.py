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
    half_a, half_b = (np.moveaxis(np.broadcast_to(half, offset.shape), -1, 0) for half in (half_a, half_b))  # (3, ...)
    rotation = np.einsum("...ji,...jk->ik...", turn_a, turn_b)
    size = np.abs(rotation)
    shift = np.einsum("...ji,...j->i...", turn_a, offset)  # in a's axes
    gap_a = np.abs(shift) - half_a - np.einsum("ij...,j...->i...", size, half_b)
    shift_b = np.einsum("ji...,j...->i...", rotation, shift)
    gap_b = np.abs(shift_b) - half_b - np.einsum("ij...,i...->j...", size, half_a)
    k, m = [1, 2, 0], [2, 0, 1]
    distance = np.abs(shift[m, None] * rotation[k] - shift[k, None] * rotation[m])  # (3, 3, ...) along the cross products of two axes
    extent = half_a[k, None] * size[m] + half_a[m, None] * size[k]
    extent = extent + half_b[k] * size[:, m] + half_b[m] * size[:, k]
    sine2 = 1 - rotation**2
    along = np.where(sine2 > PARALLEL, (distance - extent) / np.sqrt(np.maximum(sine2, PARALLEL)), -np.inf)
    return np.asarray(np.maximum(np.maximum(gap_a.max(axis=0), gap_b.max(axis=0)), along.max(axis=(0, 1))))

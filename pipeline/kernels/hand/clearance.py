"""How deep a hand stands in an object, exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.hand.bodies import Balls
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.hand.reach import ball_points

DOUBT = 2
"""Cells: a ball that may be nearer than the grid says by as much is measured exactly; no look-up within the band errs by more."""


def deepest(field: DistanceField, balls: Balls, frames: NDArray[np.float64]) -> float:
    """Depth of the deepest rigid point in the object, or of the deepest point of the object in a rigid link, m; 0 when they are apart.

    Parameters
    ----------
    field
        The object.
    balls
        Of all rigid links, as dense as the answer is to be exact.
    frames
        (L, 4, 4) world frames of the links.
    """
    points = ball_points(balls, frames[None])[:, 0]  # (3, B)
    measured = doubtful(field, balls, points)
    if not len(measured):
        return 0.0
    gap = field.exact(points[:, measured].T) - balls.radii[measured]
    return max(0.0, -float(gap.min()))


def doubtful(field: DistanceField, balls: Balls, points: NDArray[np.float64]) -> NDArray[np.intp]:
    """The balls, with centres at `points` (3, B) in the world, that may stand in the object as far as the grid can tell."""
    return np.flatnonzero(field.lookup(points.astype(np.float32)) - balls.radii < DOUBT * field.cell)

"""How deep a hand stands in an object, exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.hand.bodies import Balls
from pipeline.kernels.hand.distance import DistanceField
from pipeline.kernels.hand.reach import ball_points

DOUBT = 0.004
"""m: a ball this much nearer than the grid says is measured exactly; beyond what the grid can err near an edge, two cells."""


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
    doubtful = np.flatnonzero(field.lookup(points.astype(np.float32)) - balls.radii < DOUBT)
    if not len(doubtful):
        return 0.0
    gap = field.exact(points[:, doubtful].T) - balls.radii[doubtful]
    return max(0.0, -float(gap.min()))

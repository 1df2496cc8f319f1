"""Penetration of a hand into an object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.hand.collision_shapes import CollisionSpheres
from pipeline.kernels.hand.distance_field import DistanceField

DOUBT = 2
"""Cells: a sphere that may be nearer than the grid says by this much is measured exactly. No look-up within the band errs by more."""


def penetration_depth(field: DistanceField, spheres: CollisionSpheres, frames: NDArray[np.float64]) -> float:
    """Compute the depth of the deepest rigid point in the object, or of the object's deepest point in a rigid link.

    Parameters
    ----------
    field
        The object.
    spheres
        Of all rigid links; their spacing is the error.
    frames
        (L, 4, 4) link frames, world.

    Returns
    -------
    m; 0 when hand and object are apart.
    """
    points = spheres.world_centres(frames[None])[:, 0]  # (3, B)
    measured = doubtful_spheres(field, spheres, points)
    if not len(measured):
        return 0.0
    gap = field.exact(points[:, measured].T) - spheres.radii[measured]
    return max(0.0, -float(gap.min()))


def doubtful_spheres(field: DistanceField, spheres: CollisionSpheres, points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Select the spheres that may overlap the object as far as the grid can tell.

    Parameters
    ----------
    field
        The object.
    spheres
        B spheres.
    points
        (3, B) float64, their centres, world, m.

    Returns
    -------
    (K,) intp, numbers of the selected spheres, ascending.
    """
    return np.flatnonzero(field.lookup(points.astype(np.float32)) - spheres.radii < DOUBT * field.cell)

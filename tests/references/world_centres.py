"""Where collision spheres are, link by link: the slow twin of what compiled loops compute."""

from itertools import pairwise

import numpy as np

from pipeline.kernels.hand.collision_shapes import CollisionSpheres


def world_centres(spheres: CollisionSpheres, frames: np.ndarray) -> np.ndarray:
    """Compute the centres (..., B, 3) of spheres for link frames (..., L, 4, 4), in the frame of reference of those, m."""
    points = np.empty((*frames.shape[:-3], 3, len(spheres.link)))
    starts = np.flatnonzero(np.diff(spheres.link, prepend=-1))  # of each link's spheres
    for start, stop in pairwise([*starts, len(spheres.link)]):
        rows, (x, y, z) = frames[..., spheres.link[start], :3, :, None], spheres.centres[start:stop].T
        points[..., start:stop] = (rows[..., 0, :] * x + rows[..., 1, :] * y) + (rows[..., 2, :] * z + rows[..., 3, :])
    return np.swapaxes(points, -1, -2)

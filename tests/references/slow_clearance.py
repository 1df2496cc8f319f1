"""Clearance of fingers on a distance grid, in numpy, in the same order of additions."""

import numpy as np

from pipeline.kernels.hand.distance_field import DistanceField
from pipeline.kernels.hand.grasp_ik import GraspIk


def slow_distance(field: DistanceField, points: np.ndarray) -> np.ndarray:
    """Distances (...) of points (..., 3) float32, to first order from the nearest cell."""
    single = np.float32
    place = np.clip((points - field.origin.astype(single)) * single(1 / field.cell), 0, np.array(field.inside.shape, single) - 1)
    index = (place + single(0.5)).astype(np.int64)
    x, y, z = np.moveaxis((place - index.astype(single)) * single(field.cell), -1, 0)
    value, along_x, along_y, along_z = np.moveaxis(field.records[tuple(np.moveaxis(index, -1, 0))], -1, 0)
    return value + ((along_x * x + along_y * y) + along_z * z)


def slow_clearance(ik: GraspIk, field: DistanceField, frames: np.ndarray) -> np.ndarray:
    """(N, F) m, of the nearest sphere of each finger."""
    clearance = []
    for own in ik.fingers:
        links = frames.astype(np.float32)[:, own.link]
        turned = links[..., :3, :3] * own.centres.astype(np.float32)[:, None]
        centres = (turned[..., 0] + turned[..., 1]) + (turned[..., 2] + links[..., :3, 3])
        clearance.append((slow_distance(field, centres) - own.radii.astype(np.float32)).min(axis=1))
    return np.stack(clearance, axis=1)

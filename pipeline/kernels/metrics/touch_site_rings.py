"""The square rings around a touch site in which the local Chamfer distance of Table 2 is measured."""

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats


def ring_indices(
    points: Floats,  # (N, 3) world, m
    pose: Array,  # (4, 4) sensor frame to world, m
    width: float,  # m, side of the sensor
    rings: int = 5,
) -> NDArray[np.int64]:  # (N,) 0 for the ring ×1, -1 for a point in none
    """Find the ring around a sensor in which each surface point lies.

    Ring k of 1, 2, … holds the points with |x|, |y| ≤ k · width / 2 in the sensor's frame that are not in ring k - 1, and with
    |z| ≤ width, or else the far side of the object would count.
    """
    if points.ndim != 2 or points.shape[1] != 3 or pose.shape != (4, 4):
        raise ValueError(f"points {points.shape} and pose {pose.shape}: they must be (number, 3) and (4, 4)")
    if not 0 < width < np.inf or rings < 1:
        raise ValueError(f"{rings} rings of a sensor {width} m wide: both must be above 0 and finite")
    if not (np.isfinite(points).all() and np.isfinite(pose).all()):
        raise InvalidInput("points or pose hold NaN or infinity: that lies in no ring, but is not outside either")
    local = (np.asarray(points, np.float64) - pose[:3, 3]) @ pose[:3, :3]  # (N, 3) sensor frame
    across = np.abs(local[:, :2]).max(axis=1)
    multiple = np.searchsorted(np.arange(1, rings + 1) * (width / 2), across, side="left")  # an edge belongs to the inner ring
    outside = (multiple == rings) | (np.abs(local[:, 2]) > width)
    return np.where(outside, -1, multiple)


def ring_means(
    squared: Array,  # (N,) of each surface point, m²
    ring: NDArray[np.int64],  # (N,) from `ring_indices`
    rings: int = 5,
) -> tuple[Array, NDArray[np.int64]]:  # (rings,) m², and (rings,)
    """Compute the mean squared distance per ring, and the number of its points.

    A ring without points has count 0 and mean 0, which is no value.
    """
    if squared.shape != ring.shape or squared.ndim != 1:
        raise ValueError(f"squared distances {squared.shape} and rings {ring.shape}: they must be (number,) and the same")
    if len(ring) and not (ring.min() >= -1 and ring.max() < rings):
        raise ValueError(f"rings reach from {ring.min()} to {ring.max()}: there are rings 0 to {rings - 1}, and -1 for none")
    inside = ring >= 0
    if not np.isfinite(squared[inside]).all():
        raise InvalidInput(f"squared distances hold NaN or infinity in {np.count_nonzero(~np.isfinite(squared[inside]))} points of a ring")
    count = np.bincount(ring[inside], minlength=rings)
    total = np.bincount(ring[inside], weights=squared[inside], minlength=rings)
    return total / np.maximum(count, 1), count

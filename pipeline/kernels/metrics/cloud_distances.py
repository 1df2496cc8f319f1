"""Chamfer distance, precision, recall and F1 of point clouds, in float64, and the rings around touch sites of Table 2.

Clouds are finite, (N, 3), N >= 1, in m; squared distances err by less than 1e-14 of themselves.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats, Integers, check_shape
from pipeline.kernels.metrics.nearest_points import Cloud, checked_cloud

TABLE_3_FACTOR = 9000.0  # times the Chamfer distance in m² gives Table 3's values (so would 5,000 to 12,000)
MAX_NEIGHBOURS = 16  # nearest points among which one on the same side of a surface is searched


@dataclass(frozen=True)
class CloudDistances:
    """Squared nearest distances between a predicted cloud and the true one, m²."""

    predicted: Array  # (P,) from each predicted point to the truth
    truth: Array  # (T,) from each true point to the prediction
    nearest_true: Integers  # (P,) the true point nearest to each predicted one
    nearest_predicted: Integers  # (T,) the predicted point nearest to each true one

    @property
    def chamfer(self) -> float:
        """Chamfer distance, m²: the mean squared nearest distance, both directions summed."""
        return float(self.predicted.mean() + self.truth.mean())

    @property
    def mean_distance(self) -> float:
        """Mean nearest distance, m: the mean of both directions'."""
        return float(np.sqrt(self.predicted).mean() + np.sqrt(self.truth).mean()) / 2

    def precision_recall(self, tau: float, scale: float = 1.0) -> tuple[float, float]:
        """Compute the shares of predicted and of true points whose squared distance from the other cloud, scaled, is at most `tau`."""
        precision, recall = (float(np.mean(squared * scale**2 <= tau)) for squared in (self.predicted, self.truth))
        return precision, recall

    def f1(self, tau: float, scale: float = 1.0) -> float:
        """Compute the harmonic mean of precision and recall (Table 4's protocol), 0 where both are 0; see `precision_recall`."""
        precision, recall = self.precision_recall(tau, scale)
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def cloud_distances(predicted: Floats | Cloud, truth: Floats | Cloud) -> CloudDistances:
    """Compute the squared nearest distances between two clouds, (P, 3) and (T, 3), both ways."""
    ours, theirs = (cloud if isinstance(cloud, Cloud) else Cloud(cloud) for cloud in (predicted, truth))
    (squared, nearest_true), (squared_truth, nearest_predicted) = theirs.nearest(ours), ours.nearest(theirs)
    return CloudDistances(squared, squared_truth, nearest_true, nearest_predicted)


def sampling_distance(area: float, count: int) -> float:
    """Compute the mean nearest distance, √(A / n) / 2, m, between two samplings of one surface, as for `sampling_floor`."""
    return float(np.sqrt(np.pi * sampling_floor(area, count) / 8))


def sampling_floor(area: float, count: int) -> float:  # m²
    """Compute the Chamfer distance between two samplings, of n points, of a surface of area A: what a perfect reconstruction measures.

    It is 2A / (π n): for points scattered at random over a plane, the squared distance to the nearest has mean A / (π n).
    """
    if not 0 <= area < np.inf or count < 1:
        raise ValueError(f"area {area} m², {count} points: area must be finite and ≥ 0, count ≥ 1")
    return 2 * area / (np.pi * count)


def sampling_share(area: float, count: int, distance: float) -> float:
    """Compute the share of points within `distance`, m, of another sampling of their surface: 1 - exp(-π n d² / A).

    It is the F1 that a perfect reconstruction measures. Area (above 0) and count are those of `sampling_floor`.
    """
    return float(-np.expm1(-2 * distance**2 / sampling_floor(area, count)))


def sampled_area(
    points: Floats,  # (N, 3) m; N at least 2
    normals: Floats | None = None,  # (N, 3) unit
) -> float:  # m²
    """Estimate the area of the surface from which `points` were drawn area-uniformly.

    It is the area on which as many random points would have the nearest distances that these have on their side: accurate to 1/√N, but a
    little too small around edges, and by 5 % where parts are as thin as a few distances between points. Without normals, two sides of a
    surface that are nearer than neighbouring points count once, as `sampling_floor` needs; with them, both count.
    """
    points = checked_cloud("points", points)
    distances, neighbours = scipy.spatial.cKDTree(points).query(
        points, k=2 if normals is None else [*range(2, 2 + min(MAX_NEIGHBOURS, len(points) - 1))]
    )
    if normals is None:
        nearest = distances[:, 1]
    else:
        same_side = (normals[neighbours] * normals[:, None]).sum(axis=2) > -0.5  # (N, near); around an edge of 90°, too
        same_side[:, -1] = True  # all the others are on the other side: rare, and the last of them is not too near
        nearest = np.take_along_axis(distances, same_side.argmax(axis=1)[:, None], axis=1)[:, 0]
    return float(np.pi * (len(points) - 1) * np.square(nearest).mean())


def ring_indices(points: Floats, pose: Array, width: float, rings: int) -> NDArray[np.int64]:  # (N,)
    """Find the ring in which each surface point (N, 3) lies around a sensor, `width` m wide, at a pose (4, 4): 0, 1, … or -1.

    Ring k of 1, 2, … holds the points with |x|, |y| ≤ k · width / 2 in the sensor's frame that are not in ring k - 1, and with
    |z| ≤ width, or else the far side of the object would count. It has number k - 1; a point in none has -1.
    """
    check_shape("points", points, "N", 3)
    check_shape("pose", pose, 4, 4)
    if not (np.isfinite(points).all() and np.isfinite(pose).all()):
        raise InvalidInput("points or pose hold NaN or infinity: that lies in no ring, but is not outside either")
    local = (np.asarray(points, np.float64) - pose[:3, 3]) @ pose[:3, :3]  # (N, 3) sensor frame
    across = np.abs(local[:, :2]).max(axis=1)
    multiple = np.searchsorted(np.arange(1, rings + 1) * (width / 2), across, side="left")  # an edge belongs to the inner ring
    outside = (multiple == rings) | (np.abs(local[:, 2]) > width)
    return np.where(outside, -1, multiple)


def ring_means(squared: Array, ring: NDArray[np.int64], rings: int) -> tuple[Array, NDArray[np.int64]]:  # (rings,) each
    """Compute the mean squared distance per ring, m², of points (N,), and the number of its points; of none, the mean is 0."""
    inside = ring >= 0
    if not np.isfinite(squared[inside]).all():
        raise InvalidInput(f"squared distances hold NaN or infinity in {np.count_nonzero(~np.isfinite(squared[inside]))} points of a ring")
    count = np.bincount(ring[inside], minlength=rings)
    total = np.bincount(ring[inside], weights=squared[inside], minlength=rings)
    return total / np.maximum(count, 1), count

"""Chamfer distance, precision, recall and F1 of point clouds, in float64.

Clouds are finite, (N, 3), N >= 1, in m; squared distances err by less than 1e-14 of themselves.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats
from pipeline.kernels.geometry.mesh import check_coordinates

TABLE_3_FACTOR = 9000.0
"""Table 3's values are consistent with this multiple of the Chamfer distance in m² (anything from 5,000 to 12,000 would be)."""
MAX_NEIGHBOURS = 16  # nearest points among which a point on the same side of a surface is searched


def nearest_squared(query: Floats, points: Floats) -> Array:
    """Compute the squared distance, (N,) m², from each query point (N, 3) to the nearest of `points` (M, 3)."""
    query, points = checked_cloud("query", query), checked_cloud("points", points)
    nearest = cKDTree(points).query(query)[1]
    return np.asarray(np.square(query - points[nearest]).sum(axis=1))


@dataclass(frozen=True)
class CloudDistances:
    """Squared nearest distances between a predicted cloud and the true one, m²."""

    predicted: Array  # (P,) from each predicted point to the truth
    truth: Array  # (T,) from each true point to the prediction

    @property
    def chamfer(self) -> float:
        """Chamfer distance, m²: the mean squared nearest distance, both directions summed."""
        return float(self.predicted.mean() + self.truth.mean())

    @property
    def mean_distance(self) -> float:
        """Mean nearest distance, m: the mean of both directions'."""
        return float(np.sqrt(self.predicted).mean() + np.sqrt(self.truth).mean()) / 2

    def precision_recall(
        self,
        tau: float,  # greatest squared distance that counts as near, m² of the scaled clouds
        scale: float = 1.0,  # factor that both clouds are multiplied by beforehand
    ) -> tuple[float, float]:
        """Compute precision and recall: the shares of predicted and of true points that are near the other cloud."""
        if not (tau >= 0 and 0 < scale < np.inf):
            raise ValueError(f"squared distance {tau}, scale {scale}: the distance is at least 0, the scale above it and finite")
        precision, recall = (float(np.mean(squared * scale**2 <= tau)) for squared in (self.predicted, self.truth))
        return precision, recall

    def f1(self, tau: float, scale: float = 1.0) -> float:
        """Compute the harmonic mean of precision and recall (Table 4's protocol), 0 where both are 0; see `precision_recall`."""
        precision, recall = self.precision_recall(tau, scale)
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def cloud_distances(predicted: Floats, truth: Floats) -> CloudDistances:
    """Compute the squared nearest distances between two clouds, (P, 3) and (T, 3), both ways."""
    return CloudDistances(nearest_squared(predicted, truth), nearest_squared(truth, predicted))


def sampling_distance(area: float, count: int) -> float:
    """Compute the mean nearest distance between two samplings of one surface: what a perfect reconstruction measures.

    It is √(A / n) / 2, m: the mean of the distribution whose mean square is A / (π n), as for `sampling_floor`.
    """
    return float(np.sqrt(np.pi * sampling_floor(area, count) / 8))


def sampling_floor(
    area: float,  # A, m²
    count: int,  # n, points of each sampling
) -> float:  # m²
    """Compute the Chamfer distance between two samplings of one surface: what a perfect reconstruction measures.

    It is 2A / (π n): for points scattered at random over a plane, n on an area A, the squared distance to the nearest
    has mean A / (π n).
    """
    if not 0 <= area < np.inf or count < 1:
        raise ValueError(
            f"an area of {area} m² with {count} points has no sampling floor: the area is finite and at least 0, the points at least 1"
        )
    return 2 * area / (np.pi * count)


def sampling_share(area: float, count: int, distance: float) -> float:
    """Compute the share of points within `distance`, m, of another sampling of their surface.

    It is the F1 that a perfect reconstruction measures: 1 - exp(-π n d² / A), for points scattered at random over a
    plane. Area (above 0) and count are those of `sampling_floor`.
    """
    return float(-np.expm1(-2 * distance**2 / sampling_floor(area, count)))


def sampled_area(
    points: Floats,  # (N, 3) m; N at least 2
    normals: Floats | None = None,  # (N, 3) unit
) -> float:  # m²
    """Estimate the area of the surface from which `points` were drawn area-uniformly.

    It is the area on which as many random points would have the nearest distances that these have on their side:
    accurate to 1/√N, but a little too small around edges, and by 5 % where parts are as thin as a few distances between
    points. Without normals, two sides of a surface that are nearer than neighbouring points count once, as nearest
    distances see them (which `sampling_floor` needs); with them, both count.
    """
    points = checked_cloud("points", points)
    if len(points) < 2:
        raise ValueError(f"{len(points)} points are too few to estimate an area; give at least 2")
    distances, neighbours = cKDTree(points).query(points, k=2 if normals is None else [*range(2, 2 + min(MAX_NEIGHBOURS, len(points) - 1))])
    if normals is None:
        nearest = distances[:, 1]
    else:
        same_side = (normals[neighbours] * normals[:, None]).sum(axis=2) > -0.5  # (N, near); around an edge of 90°, too
        same_side[:, -1] = True  # all the others are on the other side: rare, and the last of them is not too near
        nearest = np.take_along_axis(distances, same_side.argmax(axis=1)[:, None], axis=1)[:, 0]
    return float(np.pi * (len(points) - 1) * np.square(nearest).mean())


def checked_cloud(name: str, points: Floats) -> Array:
    """Convert a cloud (N, 3), N at least 1, to float64, and check it; `name` it in messages."""
    cloud: Array = np.asarray(points, np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise ValueError(f"{name} has shape {cloud.shape}; a cloud is (number, 3)")
    if not len(cloud):
        raise InvalidInput(f"{name} is an empty cloud and holds no nearest point; check the surface it was drawn from")
    check_coordinates(cloud, f"points of {name}")
    return cloud


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

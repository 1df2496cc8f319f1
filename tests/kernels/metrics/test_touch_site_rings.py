"""Rings around a touch site against their definition."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.kernels.metrics.cloud_distances import ring_indices, ring_means

WIDTH = 0.016


def slow_ring(point, pose, width, rings):
    """Compute the definition, point by point."""
    x, y, z, _ = np.linalg.inv(pose) @ np.append(point, 1)
    if abs(z) > width:
        return -1
    for k in range(1, rings + 1):
        if abs(x) <= k * width / 2 and abs(y) <= k * width / 2:
            return k - 1
    return -1


def a_pose(rng):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    pose[:3, 3] = rng.normal(size=3)
    return pose


@pytest.mark.parametrize("rings", [1, 5])
def test_rings_follow_the_definition(rings):
    rng = np.random.default_rng(0)
    pose = a_pose(rng)
    points = pose[:3, 3] + rng.uniform(-3.5, 3.5, size=(3000, 3)) * WIDTH
    expected = [slow_ring(point, pose, WIDTH, rings) for point in points]
    np.testing.assert_array_equal(ring_indices(points, pose, WIDTH, rings), expected)


def test_points_on_edges_belong_to_the_inner_ring_and_far_points_to_no_ring():
    points = np.array([[0.5, 0, 0], [0, -1.0, 0], [2.5, 2.5, 1.0], [0, 0, 1.001], [0, 0, -1.001], [2.501, 0, 0]])
    np.testing.assert_array_equal(ring_indices(points, np.eye(4), 1.0), [0, 1, 4, -1, -1, -1])


def test_means_and_counts_of_rings():
    mean, count = ring_means(np.array([1.0, 3.0, 5.0, 7.0]), np.array([0, 0, -1, 2]), 4)
    np.testing.assert_array_equal(mean, [2, 0, 7, 0])
    np.testing.assert_array_equal(count, [2, 0, 1, 0])


@pytest.mark.parametrize(
    ("points", "pose", "width", "message"),
    [
        (np.zeros((10, 2)), np.eye(4), WIDTH, r"\(10, 2\)"),
        (np.zeros((10, 3)), np.eye(3), WIDTH, r"\(3, 3\)"),
        (np.full((3, 3), np.inf), np.eye(4), WIDTH, "points or pose"),
        (np.zeros((3, 3)), np.full((4, 4), np.nan), WIDTH, "points or pose"),
    ],
)
def test_ring_indices_reject_invalid_points_pose_or_width(points, pose, width, message):
    with pytest.raises(ValueError, match=message):
        ring_indices(points, pose, width)


@pytest.mark.parametrize(
    ("distances", "rings", "named"),
    [
        (np.array([0.0, np.nan]), np.array([0, 2]), "1 points"),
        (np.array([0.0, np.inf]), np.array([0, 2]), "1 points"),
    ],
)
def test_ring_means_reject_invalid_rings_and_distances(distances, rings, named):
    with pytest.raises(ValueError, match=named):
        ring_means(distances, rings)


def test_ring_means_ignore_points_in_no_ring():
    assert ring_means(np.array([1.0, np.nan]), np.array([0, -1]))[0][0] == 1

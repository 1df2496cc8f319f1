"""Rings around a touch site against their definition, at any scale and position."""

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from pipeline.kernels.metrics.cloud_distances import ring_indices, ring_means
from tests.kernels.degenerate_clouds import OFFSETS
from tests.strategies import scales, seeds

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


@given(seed=seeds, scale=scales, offset=OFFSETS)
def test_rings_ignore_scale_and_offset(seed: int, scale: float, offset: np.ndarray) -> None:
    """Except points that rounding at that offset may move over an edge."""
    rng = np.random.default_rng(seed)
    pose, width = a_pose(rng), 0.016 * scale
    pose[:3, 3] = offset
    points = offset + rng.uniform(-3, 3, (60, 3)) * width
    local = (points - offset) @ pose[:3, :3]
    edges = np.append(np.arange(1, 6) / 2, 1.0) * width
    clear = np.abs(np.abs(local)[:, :, None] - edges).min(axis=(1, 2)) > 1e-14 * (np.abs(offset).max() + width)
    assert clear.any()
    turned = np.eye(4)
    turned[:3, :3] = pose[:3, :3]
    expected = np.array([slow_ring(point - offset, turned, width, 5) for point in points])
    assert (ring_indices(points, pose, width)[clear] == expected[clear]).all()


def test_every_ring_of_a_plane_has_its_share():
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-2.5, 2.5, size=(200_000, 2)), np.zeros(200_000)])
    count = ring_means(np.ones(len(points)), ring_indices(points, np.eye(4), 1.0))[1]
    np.testing.assert_allclose(count / count.sum(), np.array([1, 3, 5, 7, 9]) / 25, rtol=0.03)


def test_points_on_edges_belong_to_the_inner_ring_and_far_points_to_no_ring():
    points = np.array([[0.5, 0, 0], [0, -1.0, 0], [2.5, 2.5, 1.0], [0, 0, 1.001], [0, 0, -1.001], [2.501, 0, 0]])
    np.testing.assert_array_equal(ring_indices(points, np.eye(4), 1.0), [0, 1, 4, -1, -1, -1])


def test_means_and_counts_of_rings():
    mean, count = ring_means(np.array([1.0, 3.0, 5.0, 7.0]), np.array([0, 0, -1, 2]), 4)
    np.testing.assert_array_equal(mean, [2, 0, 7, 0])
    np.testing.assert_array_equal(count, [2, 0, 1, 0])


def test_ring_means_without_points_are_zero():
    far = np.full((10, 3), 100.0)
    mean, count = ring_means(np.ones(10), ring_indices(far, np.eye(4), WIDTH))
    assert (mean == 0).all()
    assert (count == 0).all()
    mean, count = ring_means(np.zeros(0), ring_indices(np.zeros((0, 3)), np.eye(4), WIDTH))
    assert mean.shape == count.shape == (5,)


def test_ring_means_distinguish_zero_distance_from_no_point() -> None:
    mean, count = ring_means(np.zeros(1), np.array([4]))
    assert mean.tolist() == [0] * 5
    assert count.tolist() == [0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("points", "pose", "width", "message"),
    [
        (np.zeros((10, 2)), np.eye(4), WIDTH, r"\(10, 2\)"),
        (np.zeros((10, 3)), np.eye(3), WIDTH, r"\(3, 3\)"),
        (np.full((3, 3), np.nan), np.eye(4), WIDTH, "points or pose hold NaN"),
        (np.full((3, 3), np.inf), np.eye(4), WIDTH, "points or pose hold NaN or infinity"),
        (np.zeros((3, 3)), np.full((4, 4), np.nan), WIDTH, "points or pose hold NaN"),
        (np.zeros((3, 3)), np.eye(4), 0.0, "a sensor 0.0 m wide: both must be above 0"),
        (np.zeros((3, 3)), np.eye(4), np.inf, "5 rings of a sensor inf m wide"),
        (np.zeros((3, 3)), np.eye(4), np.nan, "sensor nan m"),
    ],
)
def test_ring_indices_reject_invalid_points_pose_or_width(points, pose, width, message):
    with pytest.raises(ValueError, match=message):
        ring_indices(points, pose, width)


def test_ring_means_reject_invalid_rings_and_distances() -> None:
    with pytest.raises(ValueError, match=r"\(3,\)"):
        ring_means(np.zeros(3), np.zeros(4, int))
    for ring in (5, -2):
        with pytest.raises(ValueError, match=f"rings reach from .*{ring}"):
            ring_means(np.zeros(2), np.array([0, ring]))
    for value in (np.nan, np.inf):
        with pytest.raises(ValueError, match="NaN or infinity in 1 points of a ring"):
            ring_means(np.array([0.0, value]), np.array([0, 2]))
    assert ring_means(np.array([1.0, np.nan]), np.array([0, -1]))[0][0] == 1  # it lies in no ring

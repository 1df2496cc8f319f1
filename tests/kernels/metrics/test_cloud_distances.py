"""Distances of clouds, sampling floors, and rings around touch sites."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.kernels.metrics.cloud_distances import (
    cloud_distances,
    ring_indices,
    ring_means,
    sampled_area,
    sampling_distance,
    sampling_floor,
    sampling_share,
)
from pipeline.kernels.metrics.nearest_points import Cloud


def sphere(radius, count, rng):
    directions = rng.normal(size=(count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def plane(count, rng, *, width=1.0, height=0.0):
    return np.column_stack([rng.random((count, 2)) * width, np.full(count, height)])


def test_chamfer_of_parallel_planes_is_twice_their_squared_distance():
    grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)
    assert cloud_distances(grid, grid + [0, 0, 0.3]).chamfer == pytest.approx(2 * 0.3**2)


@pytest.mark.parametrize("counts", [(300, 400), (1, 33), (64, 1)])
@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_distances_are_the_least_of_all_pairs(counts, offset):
    rng = np.random.default_rng(2)
    predicted, truth = sphere(1.0, counts[0], rng), sphere(1.1, counts[1], rng) + offset
    pairs = np.square(predicted[:, None] - truth).sum(axis=2)
    for distances in (cloud_distances(predicted, truth), cloud_distances(predicted, Cloud(truth))):
        np.testing.assert_array_equal(distances.predicted, pairs.min(axis=1))
        np.testing.assert_array_equal(distances.truth, pairs.min(axis=0))
        np.testing.assert_array_equal(distances.nearest_true, pairs.argmin(axis=1))
        np.testing.assert_array_equal(distances.nearest_predicted, pairs.argmin(axis=0))


def test_points_of_which_many_are_equal_have_exact_distances():
    truth = np.repeat([[0.0, 0, 0], [1, 2, 2]], 100, axis=0)
    assert cloud_distances(np.array([[1.0, 2, 4]] * 40), truth).predicted.tolist() == [4.0] * 40
    assert cloud_distances(truth, truth).chamfer == 0


def test_the_mean_distance_is_in_metres_and_the_mean_of_both_directions():
    distances = cloud_distances(np.array([[0.0, 0, 0], [3, 0, 0]]), np.array([[0.0, 0, 0], [0, 4, 0], [0, 4, 0]]))
    assert distances.mean_distance == pytest.approx((3 / 2 + 8 / 3) / 2)
    directions = sphere(1.0, 500, np.random.default_rng(1))
    assert cloud_distances(0.5 * directions, 0.8 * directions).mean_distance == pytest.approx(0.3)


def test_two_samplings_of_a_plane_are_as_far_apart_as_sampling_allows():
    rng = np.random.default_rng(6)
    count, width = 20_000, 0.4
    measured = cloud_distances(plane(count, rng, width=width), plane(count, rng, width=width))
    assert measured.chamfer == pytest.approx(sampling_floor(width**2, count), rel=0.03)
    assert measured.mean_distance == pytest.approx(sampling_distance(width**2, count), rel=0.02)
    for near in (1e-3, 2e-3):
        assert measured.f1(near**2) == pytest.approx(sampling_share(width**2, count, near), abs=0.01)


@pytest.mark.parametrize("count", [1_000, 10_000])
def test_sampled_area_of_a_sphere(count):
    points = sphere(0.2, count, np.random.default_rng(2))
    assert sampled_area(points) == pytest.approx(4 * np.pi * 0.2**2, rel=4 / np.sqrt(count))


@pytest.mark.parametrize("thickness", [1e-5, 1e-2, 0.3])
def test_sampled_area_with_normals_counts_both_sides_of_a_thin_sheet(thickness):
    rng = np.random.default_rng(8)
    sheet = np.concatenate([plane(5000, rng), plane(5000, rng, height=thickness)])
    normals = np.repeat([[0.0, 0, -1], [0, 0, 1]], 5000, axis=0)
    assert sampled_area(sheet, normals) == pytest.approx(2.0, rel=0.05)


def test_copies_of_a_point_have_zero_area_and_sampling_floor() -> None:
    assert sampled_area(np.full((9, 3), 1e2)) == 0
    assert sampling_floor(0.0, 1) == 0


def test_precision_counts_predicted_points_and_recall_true_ones():
    truth = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0.0]])
    predicted = np.array([[0, 0, 0.05], [0, 0, 0.2]])
    distances = cloud_distances(predicted, truth)
    assert distances.precision_recall(0.01) == (0.5, 0.25)
    assert distances.f1(0.01) == pytest.approx(2 * 0.5 * 0.25 / 0.75)
    assert distances.f1(1e-9) == 0
    assert distances.precision_recall(0.01, scale=0.4) == (1.0, 0.25)  # 0.2 m become 0.08 m


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        (np.zeros((0, 3)), "empty"),
        (np.zeros((4, 2)), r"\(4, 2\)"),
        (np.array([[0, 0, np.nan], [0, 0, 0]]), "1 of "),
        (np.array([[0, 0, np.inf], [0, 0, 0]]), "1 of "),
    ],
)
def test_invalid_clouds_are_rejected(bad, named):
    good = np.zeros((1, 3))
    for function, clouds in (
        (cloud_distances, (bad, good)),
        (cloud_distances, (good, bad)),
        (sampled_area, (bad,)),
    ):
        with pytest.raises(ValueError, match=named):
            function(*clouds)


@pytest.mark.parametrize(
    ("function", "arguments", "named"),
    [
        (sampling_floor, (math.nan, 10), "nan"),
        (sampling_floor, (-1.0, 10), "-1.0"),
        (sampling_floor, (1.0, 0), "0 points"),
    ],
)
def test_invalid_limits_areas_and_counts_are_rejected(function, arguments, named):
    with pytest.raises(ValueError, match=named):
        function(*arguments)


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
    np.testing.assert_array_equal(ring_indices(points, np.eye(4), 1.0, 5), [0, 1, 4, -1, -1, -1])


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
        ring_indices(points, pose, width, 5)


@pytest.mark.parametrize(
    ("distances", "rings", "named"),
    [
        (np.array([0.0, np.nan]), np.array([0, 2]), "1 points"),
        (np.array([0.0, np.inf]), np.array([0, 2]), "1 points"),
    ],
)
def test_ring_means_reject_invalid_rings_and_distances(distances, rings, named):
    with pytest.raises(ValueError, match=named):
        ring_means(distances, rings, 5)


def test_ring_means_ignore_points_in_no_ring():
    assert ring_means(np.array([1.0, np.nan]), np.array([0, -1]), 1)[0][0] == 1

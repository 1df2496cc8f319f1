"""Cloud distances, sampling floors and areas against rational arithmetic and closed forms, at any scale and position."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.metrics.cloud_distances import (
    CloudDistances,
    cloud_distances,
    nearest_squared,
    sampled_area,
    sampling_distance,
    sampling_floor,
    sampling_share,
)
from tests.kernels.degenerate_clouds import CLOUDS, KINDS, OFFSETS, cloud
from tests.references import exact_distances as exact
from tests.strategies import scales, seeds


def sphere(radius, count, rng):
    directions = rng.normal(size=(count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def plane(count, rng, *, width=1.0, height=0.0):
    return np.column_stack([rng.random((count, 2)) * width, np.full(count, height)])


@given(first=KINDS, second=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_distances_equal_exact_arithmetic(first: str, second: str, seed: int, scale: float, offset: np.ndarray) -> None:
    a, b = cloud(first, seed, scale, offset), cloud(second, seed + 1, scale, offset)
    distances = cloud_distances(a, b)
    for each, ours, theirs in ((distances.predicted, a, b), (distances.truth, b, a)):
        np.testing.assert_allclose(each, [float(squared) for squared in exact.nearest_squared(ours, theirs)], rtol=2e-15, atol=0)
    assert distances.chamfer == pytest.approx(exact.chamfer(a, b), rel=1e-14)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("kind", sorted(CLOUDS))
def test_distances_of_a_cloud_to_itself_are_zero_in_any_type(kind: str, dtype: type[np.floating]) -> None:
    points = cloud(kind, 1, 1.0, np.zeros(3)).astype(dtype)
    distances = cloud_distances(points, points[::-1])
    assert distances.chamfer == 0
    assert distances.precision_recall(0.0) == (1, 1)
    assert distances.f1(0.0) == 1


@given(kind=KINDS, seed=seeds, power=st.integers(-20, 20))
def test_squared_distances_and_areas_scale_exactly_with_doubled_lengths(kind: str, seed: int, power: int) -> None:
    """From 1e-6 to 1e6."""
    a, b = cloud(kind, seed, 1.0, np.zeros(3)), cloud("spread", seed, 1.0, np.zeros(3))
    factor = 2.0**power
    assert cloud_distances(a * factor, b * factor).chamfer == cloud_distances(a, b).chamfer * factor**2
    assert sampled_area(b * factor) == sampled_area(b) * factor**2
    assert sampling_floor(3.0 * factor**2, 7) == sampling_floor(3.0, 7) * factor**2


@given(seeds, st.floats(1e-4, 1e3), st.floats(0.1, 10))
def test_the_chamfer_distance_and_f1_are_symmetric_and_scale(seed, scale, tau):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(30, 3)), rng.normal(size=(20, 3))
    there, back = cloud_distances(a, b), cloud_distances(b, a)
    assert there.chamfer == pytest.approx(back.chamfer)
    assert cloud_distances(scale * a, scale * b).chamfer == pytest.approx(scale**2 * there.chamfer)
    assert there.precision_recall(tau) == back.precision_recall(tau)[::-1]
    assert there.f1(tau) == pytest.approx(back.f1(tau))
    assert there.f1(tau) <= there.f1(2 * tau)
    scaled = cloud_distances(scale * a, scale * b).f1(tau)
    assert there.f1(tau, scale) == pytest.approx(scaled, abs=0.1)  # a point on the very limit may round to either side


def test_chamfer_of_parallel_planes_is_twice_their_squared_distance():
    grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)
    assert cloud_distances(grid, grid + [0, 0, 0.3]).chamfer == pytest.approx(2 * 0.3**2)


def test_chamfer_of_concentric_spheres_is_the_squared_difference_of_radii_each_way():
    rng = np.random.default_rng(1)
    directions = sphere(1.0, 4000, rng)
    distances = cloud_distances(0.5 * directions, 0.8 * directions)
    assert distances.predicted.mean() == pytest.approx(0.3**2)
    assert distances.truth.mean() == pytest.approx(0.3**2)


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


def test_sampled_area_counts_a_thin_sheet_once_as_distances_do():
    rng = np.random.default_rng(8)
    sheet = np.concatenate([plane(5000, rng), plane(5000, rng, height=1e-5)])
    other = np.concatenate([plane(5000, rng), plane(5000, rng, height=1e-5)])
    assert sampled_area(sheet) == pytest.approx(1.0, rel=0.05)
    assert cloud_distances(sheet, other).chamfer == pytest.approx(sampling_floor(sampled_area(sheet), 10_000), rel=0.05)


@pytest.mark.parametrize("thickness", [1e-5, 1e-2, 0.3])
def test_sampled_area_with_normals_counts_both_sides_of_a_thin_sheet(thickness):
    rng = np.random.default_rng(8)
    sheet = np.concatenate([plane(5000, rng), plane(5000, rng, height=thickness)])
    normals = np.repeat([[0.0, 0, -1], [0, 0, 1]], 5000, axis=0)
    assert sampled_area(sheet, normals) == pytest.approx(2.0, rel=0.05)


def test_sampled_area_with_normals_counts_neighbours_around_an_edge():
    rng = np.random.default_rng(8)
    sides = [plane(300, rng, height=height)[:, turned] for height in (0, 1) for turned in ([0, 1, 2], [1, 2, 0], [2, 0, 1])]  # of a cube
    normals = np.repeat([sign * np.eye(3)[axis] for sign in (-1, 1) for axis in (2, 1, 0)], 300, axis=0)
    assert sampled_area(np.concatenate(sides), normals) == pytest.approx(
        6.0, rel=0.04
    )  # 5 % more if neighbours around an edge do not count


def test_sampled_area_of_a_sphere_is_the_same_with_normals():
    points = sphere(0.2, 4000, np.random.default_rng(7))
    assert sampled_area(points, points / 0.2) == pytest.approx(sampled_area(points), rel=1e-9)
    assert sampled_area(points[:2], points[:2] / 0.2) == pytest.approx(sampled_area(points[:2]), rel=1e-9)


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


def test_f1_without_matches_and_with_matches_on_one_side() -> None:
    assert CloudDistances(np.array([1.0]), np.array([1.0])).f1(0.5) == 0
    assert CloudDistances(np.array([0.0]), np.array([1.0])).f1(0.5) == 0
    assert CloudDistances(np.array([0.0, 1.0]), np.array([0.0])).f1(0.0) == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.zeros((0, 3)), "an empty cloud"),
        (np.zeros((4, 2)), r"shape \(4, 2\); a cloud is"),
        (np.zeros(3), r"shape \(3,\); a cloud is"),
        *[(np.array([[0, 0, value], [0, 0, 0]]), "1 of .* are NaN, infinite") for value in (np.nan, np.inf, -np.inf)],
    ],
)
def test_invalid_clouds_are_rejected(bad, message):
    good = np.zeros((1, 3))
    for call in (
        lambda: nearest_squared(bad, good),
        lambda: cloud_distances(bad, good),
        lambda: cloud_distances(good, bad),
        lambda: sampled_area(bad),
    ):
        with pytest.raises(ValueError, match=message):
            call()


@pytest.mark.parametrize(("tau", "scale"), [(math.nan, 1.0), (-1e-9, 1.0), (1e-4, math.nan), (1e-4, 0.0), (1e-4, math.inf)])
def test_precision_recall_rejects_invalid_threshold_or_scale(tau: float, scale: float) -> None:
    distances = CloudDistances(np.zeros(1), np.zeros(1))
    for call in (distances.precision_recall, distances.f1):
        with pytest.raises(ValueError, match=f"squared distance {tau}, scale {scale}"):
            call(tau, scale)


@pytest.mark.parametrize(("area", "count"), [(math.nan, 10), (math.inf, 10), (-1.0, 10), (1.0, 0)])
def test_sampling_floor_rejects_invalid_area_or_count(area, count):
    with pytest.raises(ValueError, match=f"area of {area} m² with {count} points"):
        sampling_floor(area, count)


def test_sampled_area_rejects_a_single_point():
    with pytest.raises(ValueError, match="give at least 2"):
        sampled_area(np.zeros((1, 3)))

"""Metrics of clouds at any scale and position, of copies and of single points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances, nearest_squared, sampled_area, sampling_floor
from pipeline.kernels.metrics.touch_site_rings import ring_indices, ring_means
from tests.kernels.degenerate_clouds import CLOUDS, KINDS, OFFSETS, cloud
from tests.kernels.metrics.test_touch_site_rings import a_pose, slow_ring
from tests.references import exact_distances as exact
from tests.strategies import scales, seeds

ROUNDING = 1e-15


@given(first=KINDS, second=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_distances_are_those_of_exact_arithmetic(first: str, second: str, seed: int, scale: float, offset: np.ndarray) -> None:
    a, b = cloud(first, seed, scale, offset), cloud(second, seed + 1, scale, offset)
    found = cloud_distances(a, b)
    for each, ours, theirs in ((found.predicted, a, b), (found.truth, b, a)):
        np.testing.assert_allclose(each, [float(squared) for squared in exact.nearest_squared(ours, theirs)], rtol=2 * ROUNDING, atol=0)
    assert found.chamfer == pytest.approx(exact.chamfer(a, b), rel=1e-14)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("kind", sorted(CLOUDS))
def test_a_cloud_and_itself_agree_perfectly_in_any_type(kind: str, dtype: type[np.floating]) -> None:
    points = cloud(kind, 1, 1.0, np.zeros(3)).astype(dtype)
    found = cloud_distances(points, points[::-1])
    assert found.chamfer == 0
    assert found.precision_recall(0.0) == (1, 1)
    assert found.f1(0.0) == 1


@given(kind=KINDS, seed=seeds, power=st.integers(-20, 20))
def test_doubling_lengths_quadruples_distances_and_areas_to_the_bit(kind: str, seed: int, power: int) -> None:
    """From 1e-6 to 1e6."""
    a, b = cloud(kind, seed, 1.0, np.zeros(3)), cloud("spread", seed, 1.0, np.zeros(3))
    factor = 2.0**power
    assert cloud_distances(a * factor, b * factor).chamfer == cloud_distances(a, b).chamfer * factor**2
    assert sampled_area(b * factor) == sampled_area(b) * factor**2
    assert sampling_floor(3.0 * factor**2, 7) == sampling_floor(3.0, 7) * factor**2


def test_copies_have_no_area_and_no_floor() -> None:
    assert sampled_area(np.full((9, 3), 1e2)) == 0
    assert sampling_floor(0.0, 1) == 0


def test_f1_of_nothing_right_and_of_one_side_right() -> None:
    assert CloudDistances(np.array([1.0]), np.array([1.0])).f1(0.5) == 0
    assert CloudDistances(np.array([0.0]), np.array([1.0])).f1(0.5) == 0
    assert CloudDistances(np.array([0.0, 1.0]), np.array([0.0])).f1(0.0) == pytest.approx(2 / 3)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite_are_rejected(bad: float) -> None:
    points = np.zeros((3, 3))
    points[1, 2] = bad
    for call in (
        lambda: nearest_squared(points, np.zeros((1, 3))),
        lambda: cloud_distances(np.zeros((1, 3)), points),
        lambda: sampled_area(points),
    ):
        with pytest.raises(ValueError, match=r"1 of .* are NaN, infinite"):
            call()


@pytest.mark.parametrize(("tau", "scale"), [(math.nan, 1.0), (-1e-9, 1.0), (1e-4, math.nan), (1e-4, 0.0), (1e-4, math.inf)])
def test_precision_recall_rejects_invalid_threshold_or_scale(tau: float, scale: float) -> None:
    found = CloudDistances(np.zeros(1), np.zeros(1))
    for call in (found.precision_recall, found.f1):
        with pytest.raises(ValueError, match=f"squared distance {tau}, scale {scale}"):
            call(tau, scale)


@pytest.mark.parametrize("area", [math.nan, math.inf, -1.0])
def test_sampling_floor_rejects_invalid_area_or_count(area: float) -> None:
    with pytest.raises(ValueError, match=f"area of {area} m²"):
        sampling_floor(area, 10)


# ---- rings


@given(seed=seeds, scale=scales, offset=OFFSETS)
def test_rings_are_the_same_at_any_scale_and_place(seed: int, scale: float, offset: np.ndarray) -> None:
    """But for points that rounding at that place may carry over an edge."""
    rng = np.random.default_rng(seed)
    pose, width = a_pose(rng), 0.016 * scale
    pose[:3, 3] = offset
    points = offset + rng.uniform(-3, 3, (60, 3)) * width
    local = (points - offset) @ pose[:3, :3]
    edges = np.append(np.arange(1, 6) / 2, 1.0) * width
    clear = np.abs(np.abs(local)[:, :, None] - edges).min(axis=(1, 2)) > 1e-14 * (np.abs(offset).max() + width)
    assert clear.any()
    expected = np.array([slow_ring(point - offset, _turned(pose), width, 5) for point in points])
    assert (ring_indices(points, pose, width)[clear] == expected[clear]).all()


def _turned(pose: np.ndarray) -> np.ndarray:
    """Return the pose without its translation."""
    turned = np.eye(4)
    turned[:3, :3] = pose[:3, :3]
    return turned


def test_rings_without_points_are_empty() -> None:
    mean, count = ring_means(np.zeros(4), np.full(4, -1))
    assert mean.tolist() == count.tolist() == [0] * 5


def test_ring_means_tell_zero_distance_from_no_point() -> None:
    mean, count = ring_means(np.zeros(1), np.array([4]))
    assert mean.tolist() == [0] * 5
    assert count.tolist() == [0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("points", "pose", "width", "message"),
    [
        (np.nan, 1.0, 0.016, "points or pose hold NaN"),
        (np.inf, 1.0, 0.016, "points or pose hold NaN or infinity"),
        (0.0, np.nan, 0.016, "points or pose hold NaN"),
        (0.0, 1.0, np.inf, "5 rings of a sensor inf m wide"),
        (0.0, 1.0, np.nan, "sensor nan m"),
    ],
)
def test_ring_indices_reject_invalid_points_pose_or_width(points: float, pose: float, width: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ring_indices(np.full((3, 3), points), np.eye(4) * pose, width)


def test_ring_means_reject_invalid_rings_and_distances() -> None:
    for ring in (5, -2):
        with pytest.raises(ValueError, match=f"rings reach from .*{ring}"):
            ring_means(np.zeros(2), np.array([0, ring]))
    for value in (np.nan, np.inf):
        with pytest.raises(ValueError, match="NaN or infinity in 1 points of a ring"):
            ring_means(np.array([0.0, value]), np.array([0, 2]))
    assert ring_means(np.array([1.0, np.nan]), np.array([0, -1]))[0][0] == 1  # it lies in no ring

"""Gaps between oriented boxes against closed forms and sampled points."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.hand.box_gap import box_gap
from tests.kernels.hand.meshes import random_pose
from tests.strategies import EPS, random_rotation, scales, seeds


def two_boxes(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Poses (2, 4, 4) and half extents (2, 3); some are plates, rods or points."""
    frames = np.tile(np.eye(4), (2, 1, 1))
    frames[:, :3, :3] = [random_rotation(rng), random_rotation(rng)]
    frames[1, :3, 3] = rng.normal(size=3) * 2
    return frames, rng.uniform(0, 1, (2, 3)) * (rng.random((2, 3)) < 0.8)


def points_in(rng: np.random.Generator, frame: np.ndarray, half: np.ndarray) -> np.ndarray:
    local = rng.uniform(-1, 1, (400, 3)) * half
    return np.asarray(local @ frame[:3, :3].T + frame[:3, 3])


def test_box_gap_of_boxes_side_by_side_is_their_distance_or_overlap() -> None:
    half, other = np.array([0.1, 0.2, 0.3]), np.eye(4)
    for shift, expected in ((0.25, 0.05), (0.2, 0), (0.15, -0.05), (0, -0.2)):
        other[0, 3] = shift
        assert box_gap(np.eye(4), half, other, half) == pytest.approx(expected, abs=4 * EPS)
    assert box_gap(np.eye(4), 0 * half, np.eye(4), 0 * half) == 0


def test_box_gap_is_positive_only_for_boxes_that_are_apart(rng: np.random.Generator) -> None:
    half = np.array([0.02, 0.03, 0.04])
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 15)] * 3), axis=-1).reshape(-1, 3) * half
    seen = []
    for _ in range(300):
        a, b = random_pose(rng), random_pose(rng)
        b[:3, 3] = a[:3, 3] + rng.normal(size=3) * 0.03
        gap = float(box_gap(a, half, b, half))
        local = ((grid @ b[:3, :3].T + b[:3, 3]) - a[:3, 3]) @ a[:3, :3]  # points of b in a's frame
        distance = np.linalg.norm(np.maximum(np.abs(local) - half, 0), axis=1).min()
        assert gap <= distance + 1e-12
        if distance == 0:
            assert gap <= 0
        seen.append((gap > 0, distance > 0.006))  # the grid is 6 mm wide
    separated, clear = np.array(seen).T
    assert separated[clear].all()
    assert 0.05 < separated.mean() < 0.9


@given(seed=seeds, scale=scales)
def test_box_gap_bounds_the_distance_and_scales_and_moves_with_the_boxes(seed, scale) -> None:
    rng = np.random.default_rng(seed)
    frames, half = two_boxes(rng)
    gap = box_gap(frames[0], half[0], frames[1], half[1])
    a, b = (points_in(rng, frame, size) for frame, size in zip(frames, half, strict=True))
    assert gap <= np.linalg.norm(a[:, None] - b, axis=2).min() + 8 * EPS
    assert box_gap(frames[1], half[1], frames[0], half[0]) == pytest.approx(gap, abs=128 * EPS)
    moved, offset = frames.copy(), rng.uniform(-10, 10, 3)
    moved[:, :3, 3] = frames[:, :3, 3] * scale + offset
    found = box_gap(moved[0], half[0] * scale, moved[1], half[1] * scale)
    assert np.abs(found - gap * scale) <= 32 * EPS * (np.abs(offset).max() + 8 * scale)


@given(seed=seeds, tilt=st.floats(-9, -2).map(lambda e: 10.0**e))
def test_box_gap_of_nearly_parallel_edges_is_off_by_the_tilt_at_most(seed, tilt) -> None:
    """On either side of `PARALLEL`, where the cross product of two edges stops being an axis, beside boxes with parallel edges."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.1, 1, (2, 3))
    parallel = trimesh.transformations.rotation_matrix(rng.uniform(0, 6), [0, 0, 1])
    parallel[:3, 3] = rng.normal(size=3)
    tilted = parallel.copy()
    tilted[:3, :3] = parallel[:3, :3] @ trimesh.transformations.rotation_matrix(tilt, rng.normal(size=3))[:3, :3]
    before, after = (box_gap(np.eye(4), half[0], frame, half[1]) for frame in (parallel, tilted))
    assert after >= before - 4 * tilt
    if before < 0:
        assert after <= before + 4 * tilt

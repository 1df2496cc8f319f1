"""Rigid transforms, compared with numpy's products and scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.kernels.geometry.transforms import (
    compose,
    invert_pose,
    invert_similarity,
    length,
    rotation_from_euler,
    sin_cos,
    solve_3x3,
    solve_linear,
    transform_points,
)


@pytest.fixture
def poses(rng: np.random.Generator) -> np.ndarray:
    """(6, 4, 4) random rigid transforms."""
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, :3, :3] = Rotation.random(6, rng).as_matrix()
    poses[:, :3, 3] = rng.normal(size=(6, 3))
    return poses


def test_compose_broadcasts_as_matmul_does(poses: np.ndarray) -> None:
    for left, right in ((poses, poses[0]), (poses[0], poses), (poses[:, None], poses[:2]), (poses[0], poses[1]), (poses[:0], poses[0])):
        np.testing.assert_allclose(compose(left, right), left @ right, atol=1e-14)


def test_compose_rejects_matrices_that_do_not_fit(poses: np.ndarray) -> None:
    with pytest.raises(ValueError, match="have no product"):
        compose(poses, np.eye(3))


def test_inverted_pose_undoes_the_transform(poses: np.ndarray, rng: np.random.Generator) -> None:
    points = rng.normal(size=(6, 5, 3))
    moved = transform_points(poses, points)
    np.testing.assert_allclose(moved[2, 3], poses[2, :3, :3] @ points[2, 3] + poses[2, :3, 3], atol=1e-14)
    np.testing.assert_allclose(transform_points(invert_pose(poses), moved), points, atol=1e-14)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 7.0])
def test_inverted_similarity_undoes_motion_and_scale(poses: np.ndarray, rng: np.random.Generator, scale: float) -> None:
    similarity, points = poses[0].copy(), rng.normal(size=(5, 3))
    similarity[:3, :3] *= scale
    np.testing.assert_allclose(
        transform_points(invert_similarity(similarity), transform_points(similarity, points)), points, atol=1e-12 / scale
    )


def test_rotation_from_euler_turns_about_fixed_axes(rng: np.random.Generator) -> None:
    angles = rng.uniform(-np.pi, np.pi, 3)
    np.testing.assert_allclose(rotation_from_euler(angles), Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-14)


def test_sines_cosines_and_lengths_equal_numpys_to_rounding(rng: np.random.Generator) -> None:
    angles = rng.uniform(-7, 7, (50, 3))
    sin, cos = sin_cos(angles)
    np.testing.assert_allclose([sin, cos], [np.sin(angles), np.cos(angles)], atol=3e-16)
    assert sin.dtype == cos.dtype == np.float64
    np.testing.assert_allclose(length(angles), np.sqrt((angles**2).sum(axis=-1)), rtol=1e-15)


def test_solve_linear_solves_where_rows_must_change_places(rng: np.random.Generator) -> None:
    matrix, solution = rng.normal(size=(6, 6)), rng.normal(size=6)
    matrix[0, 0] = matrix[3, 3] = 0
    np.testing.assert_allclose(solve_linear(matrix, matrix @ solution), solution, atol=1e-12)


def test_solve_3x3_solves(rng: np.random.Generator) -> None:
    matrix, solution = rng.normal(size=(3, 3)) + 3 * np.eye(3), rng.normal(size=3)
    np.testing.assert_allclose(solve_3x3(matrix, matrix @ solution), solution, atol=1e-12)

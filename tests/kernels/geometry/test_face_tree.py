"""The search for nearest points in groups, against libigl's search for each point alone."""

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given

from pipeline.kernels.geometry.face_tree import LEAF, build_face_tree, nearest_points
from tests.strategies import seeds

LATTICE = np.argwhere(np.ones((4, 4, 4))).astype(float)


def assert_as_libigl(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, group: int) -> None:
    squared, face, nearest = nearest_points(build_face_tree(vertices, faces), points, group)
    slow_tree = igl.AABB()
    slow_tree.init(vertices, faces)
    wanted = slow_tree.squared_distance(vertices, faces, points)[0]
    np.testing.assert_allclose(np.sqrt(squared), np.sqrt(wanted), rtol=0, atol=1e-14)
    np.testing.assert_allclose(((points - nearest) ** 2).sum(axis=1), squared, rtol=1e-12, atol=1e-28)
    for point, number, found in zip(points, face, squared, strict=True):
        of_face = igl.point_mesh_squared_distance(point[None], vertices, faces[[number]])[0]
        assert np.sqrt(of_face) == pytest.approx(np.sqrt(found), rel=0, abs=1e-14)


@pytest.mark.parametrize("count", [1, 2, LEAF, LEAF + 1, 40])
@given(seed=seeds)
def test_nearest_points_are_those_of_libigl(count, seed) -> None:
    """Faces anywhere, some of them only an edge or a point; groups of 64 in a cube, and points alone."""
    rng = np.random.default_rng(seed)
    vertices, faces = rng.normal(size=(count + 2, 3)), rng.integers(0, count + 2, (count, 3))
    corners = rng.normal(size=(2, 3))
    groups = (corners[:, None] + LATTICE * 10 ** rng.uniform(-3, 0)).reshape(-1, 3)
    for points, group in ((groups, 64), (rng.normal(size=(9, 3)), 1)):
        assert_as_libigl(vertices, faces, points, group)


def test_points_inside_and_on_a_box_are_those_of_libigl() -> None:
    """Many faces are equally near there."""
    body = trimesh.creation.box((4.0, 4.0, 4.0))
    for step in (0.5, 1.0):
        assert_as_libigl(body.vertices, body.faces, LATTICE * step - 1.5 * step, 64)


def test_no_points_have_no_nearest_points() -> None:
    squared, face, nearest = nearest_points(build_face_tree(np.eye(3), np.array([[0, 1, 2]])), np.empty((0, 3)))
    assert len(squared) == len(face) == len(nearest) == 0


def test_points_whose_squares_overflow_are_infinitely_far_from_some_face() -> None:
    squared, face, _ = nearest_points(build_face_tree(np.eye(3), np.array([[0, 1, 2]])), np.full((2, 3), 1e200))
    assert (squared == np.inf).all()
    assert (face == 0).all()

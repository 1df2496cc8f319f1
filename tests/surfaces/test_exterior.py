"""Exterior points: on the surface, uniform, none on hidden geometry, normals outward, the same however the mesh is wound."""

import igl
import numpy as np
import pytest
import trimesh
from scipy import stats

from pipeline.kernels.geometry.exterior_sampling import DIRECTIONS, MIN_ESCAPES, RAY_OFFSET, EscapeTest, sample_exterior, spread_directions
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from tests.conftest import mesh_of

SPHERE = trimesh.creation.icosphere(subdivisions=3)


def distance(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    squared = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces.astype(np.int64))[0]
    return np.sqrt(squared)


@pytest.mark.parametrize(
    ("outer", "inner"),
    [(SPHERE, trimesh.creation.box((0.5, 0.5, 0.5))), (trimesh.creation.box(), trimesh.creation.box((0.9, 0.9, 0.9)))],
    ids=["box in sphere", "box in box"],
)
@pytest.mark.parametrize("wound", [1, -1], ids=["outward", "inside out"])
def test_hidden_geometry_gives_no_points(outer, inner, wound, rng):
    both = mesh_of(outer, inner)
    mesh = Mesh.bare(both.vertices, both.faces[:, ::wound])
    points, normals = sample_exterior(mesh, 10_000, rng)
    assert distance(mesh_of(outer), points).max() < 1e-12
    assert np.abs(points).max(axis=1).min() > 0.49  # off the inner body, but for nothing
    assert ((points * normals).sum(axis=1) > 0).all()


def test_an_open_bowl_is_seen_from_both_sides(rng):
    half = SPHERE.faces[(SPHERE.triangles_center[:, 2] < 0)]
    mesh = Mesh.bare(SPHERE.vertices, half)
    points, normals = sample_exterior(mesh, 5_000, rng)
    outward = (points * normals).sum(axis=1) > 0
    assert distance(mesh, points).max() < 1e-12
    assert outward.mean() > 0.2  # the convex side is always a way out
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)


def test_points_are_area_uniform(rng):
    box = trimesh.creation.box((1, 2, 3))
    points, _ = sample_exterior(mesh_of(box), 20_000, rng)
    face = _side(points, box)
    expected = np.array([2 * 3, 2 * 3, 1 * 3, 1 * 3, 1 * 2, 1 * 2]) / 22 * len(points)
    assert stats.chisquare(np.bincount(face, minlength=6), expected).pvalue > 0.001


def _side(points: np.ndarray, box: trimesh.Trimesh) -> np.ndarray:
    scaled = points / (box.extents / 2)
    axis = np.abs(scaled).argmax(axis=1)
    return 2 * axis + (scaled[np.arange(len(points)), axis] > 0)


def test_points_are_uniform_inside_a_triangle(rng):
    corner = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    points, _ = sample_triangles(corner, 40_000, rng)
    cells = np.floor(points[:, :2] * 4).astype(int)
    whole = cells.sum(axis=1) < 3  # the square cells that lie in the triangle
    counts = np.bincount(cells[whole] @ [4, 1], minlength=16)
    assert stats.chisquare(counts[counts > 0]).pvalue > 0.001


def test_the_early_stop_decides_as_the_full_count(rng):
    parts = [trimesh.creation.box((1, 1, 1)).apply_translation((x, 0, 0)) for x in (0, 1.0, 2.02)]
    mesh = mesh_of(*parts, trimesh.creation.box((0.3, 0.3, 0.3)))
    triangles = mesh.triangles
    points, face = sample_triangles(triangles, 400, rng)
    vectors = face_cross_products(triangles)[face]
    front, back = EscapeTest(mesh).count(points, vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
    np.testing.assert_array_equal(front + back >= MIN_ESCAPES, _full_count(mesh, points) >= MIN_ESCAPES)


def _full_count(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Slow twin: every direction of every point against every triangle, in float64 (Möller & Trumbore)."""
    start = RAY_OFFSET * np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    free = np.zeros(len(points), int)
    for direction in spread_directions(DIRECTIONS):
        cross = np.cross(direction, c - a)
        determinant = ((b - a) * cross).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = (points + start * direction)[:, None] - a
            u = (offset * cross).sum(axis=2) / determinant
            turned = np.cross(offset, b - a)
            v = (turned @ direction) / determinant
            t = (turned * (c - a)).sum(axis=2) / determinant
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        free += ~hit.any(axis=1)
    return free


@pytest.mark.parametrize("scale", [1e-3, 1, 1e3])
def test_scale_and_offset_change_nothing(scale):
    points, normals = sample_exterior(mesh_of(SPHERE), 1000, np.random.default_rng(1))
    moved = Mesh.bare(SPHERE.vertices * scale + 1e3 * scale, SPHERE.faces)
    far, far_normals = sample_exterior(moved, 1000, np.random.default_rng(1))
    np.testing.assert_allclose(far / scale - 1e3, points, atol=1e-9)
    np.testing.assert_allclose(far_normals, normals, atol=1e-9)


def test_a_triangle_alone_is_a_surface(rng):
    points, _ = sample_exterior(Mesh.bare([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 100, rng)
    assert points.shape == (100, 3)


def test_no_area_is_an_error(rng):
    with pytest.raises(ValueError, match="none of the 1 triangles"):
        sample_triangles(np.zeros((1, 3, 3)), 10, rng)

"""Exterior points: on the surface, uniform, none on hidden geometry, normals outward, whatever the winding."""

import igl
import numpy as np
import pytest
import trimesh
from scipy import stats

from pipeline.kernels.geometry.exterior_sampling import DIRECTIONS, MIN_ESCAPES, RAY_OFFSET, RayScene, sample_exterior, spread_directions
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products, sample_triangles
from tests.conftest import mesh_of
from tests.references.escaping_rays import count_escapes

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
def test_sampling_skips_hidden_geometry(outer, inner, wound, rng):
    both = mesh_of(outer, inner)
    mesh = Mesh.bare(both.vertices, both.faces[:, ::wound])
    points, normals = sample_exterior(mesh, 10_000, rng)
    assert distance(mesh_of(outer), points).max() < 1e-12
    assert np.abs(points).max(axis=1).min() > 0.49  # off the inner body, but for nothing
    assert ((points * normals).sum(axis=1) > 0).all()


def test_open_bowl_is_sampled_from_both_sides(rng):
    half = SPHERE.faces[(SPHERE.triangles_center[:, 2] < 0)]
    mesh = Mesh.bare(SPHERE.vertices, half)
    points, normals = sample_exterior(mesh, 5_000, rng)
    outward = (points * normals).sum(axis=1) > 0
    assert distance(mesh, points).max() < 1e-12
    assert outward.mean() > 0.2  # the convex side is always a way out
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)


def test_samples_are_area_uniform(rng):
    box = trimesh.creation.box((1, 2, 3))
    points, _ = sample_exterior(mesh_of(box), 20_000, rng)
    face = _side(points, box)
    expected = np.array([2 * 3, 2 * 3, 1 * 3, 1 * 3, 1 * 2, 1 * 2]) / 22 * len(points)
    assert stats.chisquare(np.bincount(face, minlength=6), expected).pvalue > 0.001


def _side(points: np.ndarray, box: trimesh.Trimesh) -> np.ndarray:
    scaled = points / (box.extents / 2)
    axis = np.abs(scaled).argmax(axis=1)
    return 2 * axis + (scaled[np.arange(len(points)), axis] > 0)


def test_early_stop_agrees_with_the_full_count(rng):
    parts = [trimesh.creation.box((1, 1, 1)).apply_translation((x, 0, 0)) for x in (0, 1.0, 2.02)]
    mesh = mesh_of(*parts, trimesh.creation.box((0.3, 0.3, 0.3)))
    triangles = mesh.triangles
    points, face = sample_triangles(triangles, 400, rng)
    vectors = face_cross_products(triangles)[face]
    normals, directions = vectors / np.linalg.norm(vectors, axis=1, keepdims=True), spread_directions(DIRECTIONS)
    front, back = RayScene(mesh.vertices, mesh.faces).count_escapes(points, normals, directions)
    offset = RAY_OFFSET * np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    free = count_escapes(mesh.triangles, points, directions, offset)
    np.testing.assert_array_equal(front + back >= MIN_ESCAPES, free >= MIN_ESCAPES)


@pytest.mark.parametrize(
    ("corners", "faces", "count", "named"),
    [
        (np.eye(3), [[0, 1, 2]], 0, "0 points"),
        (np.ones((3, 3)), np.zeros((0, 3)), 10, "area"),
        (np.ones((3, 3)), [[0, 1, 2]], 10, "area"),
        (np.array([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]]), [[0, 1, 2]], 10, "1 of 3 corners"),
    ],
)
def test_sampling_rejects_no_points_and_surfaces_without_area(corners, faces, count, named, rng) -> None:
    with pytest.raises(ValueError, match=named):
        sample_exterior(Mesh.bare(corners, faces), count, rng)


@pytest.mark.parametrize("thickness", [2e-5, 1e-4, 1e-2])
def test_walls_within_the_stated_thickness_have_an_outside(thickness, rng) -> None:
    """An inside-out plate: only its thickness determines which side is outside."""
    plate = trimesh.creation.box((1, 1, thickness * np.sqrt(2)))
    points, normals = sample_exterior(Mesh.bare(plate.vertices, plate.faces[:, ::-1]), 2000, rng)
    assert ((points * normals)[:, 2][np.abs(normals[:, 2]) > 0.5] > 0).all()
    assert thickness > RAY_OFFSET


def test_single_triangle_is_sampled_with_the_normal_of_its_winding(rng) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * 1e-3 + 1e3
    for faces, up in (([[0, 1, 2]], 1), ([[2, 1, 0]], -1)):
        _, normals = sample_exterior(Mesh.bare(corners, faces), 50, rng)
        np.testing.assert_allclose(normals, np.tile([0, 0, up], (50, 1)), atol=1e-9)

"""Mesh cleaning: rejected meshes, removed faces, counts; and normalisation: axis, scale and position."""

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import clean_mesh, normalise_mesh, number_positions
from tests.conftest import mesh_of

LIMIT = 10_000


def test_clean_mesh_keeps_a_sound_mesh():
    box = mesh_of(trimesh.creation.box())
    cleaned, report = clean_mesh(box, LIMIT)
    np.testing.assert_array_equal(cleaned.triangles, box.triangles)
    assert (report.degenerate_faces, report.duplicate_faces, report.watertight) == (0, 0, True)


def test_degenerate_and_duplicate_faces_are_removed_and_counted():
    box = trimesh.creation.box()
    extra = [[0, 0, 1], [1, 1, 1], box.faces[0], box.faces[3][::-1]]
    cleaned, report = clean_mesh(Mesh.bare(box.vertices, np.vstack([box.faces, extra])), LIMIT)
    assert (report.degenerate_faces, report.duplicate_faces) == (2, 2)
    assert report.watertight
    assert len(cleaned.faces) == 12


def test_sliver_of_aspect_1e8_is_kept():
    vertices = [[0, 0, 0], [1, 0, 0], [0.5, 1e-8, 0], [0, 1, 0]]
    _, report = clean_mesh(Mesh.bare(vertices, [[0, 1, 2], [0, 1, 3]]), LIMIT)
    assert report.degenerate_faces == 0


def test_unused_vertices_are_removed_unchecked():
    box = trimesh.creation.box()
    vertices = np.vstack([box.vertices, [[np.nan] * 3, [1e9] * 3]])
    assert len(clean_mesh(Mesh.bare(vertices, box.faces), LIMIT)[0].vertices) == 8


@pytest.mark.parametrize(
    ("vertices", "faces", "reason"),
    [
        ([[0, 0, 0]], np.zeros((0, 3)), "no faces"),
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "1 of 3 vertices"),
        ([[0, 0, -np.inf], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "1 of 3 vertices"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "zero area"),
        ([[1, 1, 1]] * 3, [[0, 1, 2]], "zero area"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "outside 0..2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * 11, "11 faces exceed max_faces = 10"),
    ],
)
def test_clean_mesh_rejects_mesh_without_usable_surface(vertices, faces, reason):
    with pytest.raises(InvalidInput, match=reason):
        clean_mesh(Mesh.bare(np.asarray(vertices, float), faces), 10)


def test_minus_zero_and_zero_are_the_same_position() -> None:
    places = number_positions(np.array([[0.0, 1, 2], [-0.0, 1, 2], [0.0, 1, 3]]))
    assert places[0] == places[1] != places[2]


BALL = trimesh.creation.icosphere(subdivisions=2)


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_stated_axis_points_up_without_mirroring(up, axis):
    corner = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices = np.vstack([corner.vertices, np.eye(3)[axis]])
    tall = Mesh.bare(vertices, np.vstack([corner.faces, [0, 1, 8]]))
    placed, _ = normalise_mesh(tall, up=up, diagonal=0.5, metres_per_unit=1.0)
    assert placed.vertices[8, 2] == pytest.approx(placed.vertices[:, 2].max())
    before, after = (np.linalg.det(mesh.triangles[0] - mesh.vertices[8]) for mesh in (tall, placed))
    assert after == pytest.approx(before)


@pytest.mark.parametrize(
    ("vertices", "message"),
    [(np.zeros((0, 3)), "no vertices"), (np.ones((4, 3)), "4 vertices"), (np.array([[0, 0, np.nan], [1, 1, 1]]), "1 of 2")],
)
def test_normalise_rejects_mesh_without_size(vertices, message) -> None:
    with pytest.raises(InvalidInput, match=message):
        normalise_mesh(Mesh.bare(vertices, np.zeros((0, 3))), up="z", diagonal=0.5)


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("metres_per_unit", [None, 0.01])
def test_transform_places_the_mesh(up, metres_per_unit):
    mesh = Mesh.bare(BALL.vertices * [1, 2, 3] + [5, -3, 1], BALL.faces)
    how = {"up": up, "diagonal": 0.5, "metres_per_unit": metres_per_unit}
    placed, placement = normalise_mesh(mesh, **how)
    np.testing.assert_allclose(mesh.vertices @ placement[:3, :3].T + placement[:3, 3], placed.vertices, atol=1e-14)
    assert placement[3].tolist() == [0, 0, 0, 1]

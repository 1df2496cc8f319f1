"""Mesh cleaning: rejected meshes, removed faces, counts."""

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import clean_mesh, number_positions
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

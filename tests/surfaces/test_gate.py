"""The gate: what is refused and why, what is removed and counted."""

import numpy as np
import pytest
import trimesh

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import clean_mesh
from pipeline.kernels.geometry.normalise import POSITION, normalise_mesh
from tests.conftest import mesh_of

LIMIT = 10_000


def test_a_sound_mesh_passes_unchanged():
    box = mesh_of(trimesh.creation.box())
    gated, report = clean_mesh(box, LIMIT)
    np.testing.assert_array_equal(gated.triangles, box.triangles)
    assert (report.degenerate_faces, report.duplicate_faces, report.watertight) == (0, 0, True)


def test_an_open_mesh_is_noted_as_open():
    box = trimesh.creation.box()
    assert not clean_mesh(Mesh.bare(box.vertices, box.faces[1:]), LIMIT)[1].watertight


def test_flat_and_repeated_faces_are_removed_and_counted():
    box = trimesh.creation.box()
    extra = [[0, 0, 1], [1, 1, 1], box.faces[0], box.faces[3][::-1]]
    gated, report = clean_mesh(Mesh.bare(box.vertices, np.vstack([box.faces, extra])), LIMIT)
    assert (report.degenerate_faces, report.duplicate_faces) == (2, 2)
    assert report.watertight
    assert len(gated.faces) == 12


def test_a_sliver_of_aspect_1e8_is_a_face():
    vertices = [[0, 0, 0], [1, 0, 0], [0.5, 1e-8, 0], [0, 1, 0]]
    _, report = clean_mesh(Mesh.bare(vertices, [[0, 1, 2], [0, 1, 3]]), LIMIT)
    assert report.degenerate_faces == 0


@pytest.mark.parametrize("offset", [0, 1e6])
@pytest.mark.parametrize("scale", [1e-6, 1, 1e6])
def test_scale_and_offset_change_no_verdict(scale, offset):
    box = trimesh.creation.box()
    gated, report = clean_mesh(Mesh.bare(box.vertices * scale + offset * scale, box.faces), LIMIT)
    assert report.degenerate_faces == report.duplicate_faces == 0
    placed = normalise_mesh(gated, "z", 0.5)
    np.testing.assert_allclose(np.linalg.norm(np.ptp(placed.vertices, axis=0)), 0.5, rtol=1e-9)
    np.testing.assert_allclose(placed.vertices.min(axis=0) + placed.vertices.max(axis=0), 2 * POSITION, atol=1e-9)


def test_unused_vertices_count_for_nothing():
    box = trimesh.creation.box()
    vertices = np.vstack([box.vertices, [[np.nan] * 3, [1e9] * 3]])
    assert len(clean_mesh(Mesh.bare(vertices, box.faces), LIMIT)[0].vertices) == 8


@pytest.mark.parametrize(
    ("vertices", "faces", "reason"),
    [
        ([[0, 0, 0]], np.zeros((0, 3)), "no faces"),
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "1 of 3 vertices are not finite"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "zero area"),
        ([[1, 1, 1]] * 3, [[0, 1, 2]], "zero area"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "outside 0..2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * 11, "11 faces exceed max_faces = 10"),
    ],
)
def test_what_is_no_surface_is_refused_with_a_reason(vertices, faces, reason):
    with pytest.raises(ValueError, match=reason):
        clean_mesh(Mesh.bare(np.asarray(vertices, float), faces), 10)


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_the_stated_axis_points_up_and_nothing_is_mirrored(up, axis):
    corner = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices = np.vstack([corner.vertices, np.eye(3)[axis]])
    tall = Mesh.bare(vertices, np.vstack([corner.faces, [0, 1, 8]]))
    placed = normalise_mesh(tall, up, 0.5, metres_per_unit=1.0)
    assert placed.vertices[8, 2] == pytest.approx(placed.vertices[:, 2].max())
    before, after = (np.linalg.det(mesh.triangles[0] - mesh.vertices[8]) for mesh in (tall, placed))
    assert after == pytest.approx(before)

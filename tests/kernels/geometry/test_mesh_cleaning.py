"""Mesh cleaning: rejected meshes, removed faces, counts."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import MIN_FLATNESS, clean_mesh, number_positions
from pipeline.kernels.geometry.normalise import POSITION, normalise_mesh
from tests.conftest import mesh_of
from tests.strategies import offsets, random_rotation, scales, seeds, sliver

BOX = trimesh.creation.box((0.3, 0.2, 0.4))
LIMIT = 10_000


def test_clean_mesh_keeps_a_sound_mesh():
    box = mesh_of(trimesh.creation.box())
    cleaned, report = clean_mesh(box, LIMIT)
    np.testing.assert_array_equal(cleaned.triangles, box.triangles)
    assert (report.degenerate_faces, report.duplicate_faces, report.watertight) == (0, 0, True)


def test_open_mesh_is_not_watertight():
    box = trimesh.creation.box()
    assert not clean_mesh(Mesh.bare(box.vertices, box.faces[1:]), LIMIT)[1].watertight


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


@pytest.mark.parametrize("offset", [0, 1e6])
@pytest.mark.parametrize("scale", [1e-6, 1, 1e6])
def test_cleaning_and_normalising_ignore_scale_and_offset(scale, offset):
    box = trimesh.creation.box()
    cleaned, report = clean_mesh(Mesh.bare(box.vertices * scale + offset * scale, box.faces), LIMIT)
    assert report.degenerate_faces == report.duplicate_faces == 0
    placed = normalise_mesh(cleaned, up="z", diagonal=0.5)
    np.testing.assert_allclose(np.linalg.norm(np.ptp(placed.vertices, axis=0)), 0.5, rtol=1e-9)
    np.testing.assert_allclose(placed.vertices.min(axis=0) + placed.vertices.max(axis=0), 2 * POSITION, atol=1e-9)


def test_unused_vertices_are_removed_unchecked():
    box = trimesh.creation.box()
    vertices = np.vstack([box.vertices, [[np.nan] * 3, [1e9] * 3]])
    assert len(clean_mesh(Mesh.bare(vertices, box.faces), LIMIT)[0].vertices) == 8


@pytest.mark.parametrize(
    ("vertices", "faces", "reason"),
    [
        ([[0, 0, 0]], np.zeros((0, 3)), "no faces"),
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "1 of 3 vertices are NaN"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "zero area"),
        ([[1, 1, 1]] * 3, [[0, 1, 2]], "zero area"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "outside 0..2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]] * 11, "11 faces exceed max_faces = 10"),
    ],
)
def test_clean_mesh_rejects_mesh_without_usable_surface(vertices, faces, reason):
    with pytest.raises(InvalidInput, match=reason):
        clean_mesh(Mesh.bare(np.asarray(vertices, float), faces), 10)


@given(seed=seeds, scale=scales, offset=offsets, flat=st.integers(0, 3), twice=st.integers(0, 5))
def test_cleaning_report_depends_on_shape_alone(seed, scale, offset, flat, twice) -> None:
    """The report does not depend on scale, offset, rotation, winding and order of faces."""
    rng = np.random.default_rng(seed)
    vertices = BOX.vertices @ random_rotation(rng).T * scale + offset
    faces = [BOX.faces, *([[k, k, 7 - k]] for k in range(flat)), *(rng.permutation(BOX.faces[k])[None] for k in range(twice))]
    faces = rng.permutation(np.vstack(faces))
    cleaned, report = clean_mesh(Mesh.bare(vertices, faces), 100)
    assert (report.degenerate_faces, report.duplicate_faces, report.watertight) == (flat, twice, True)
    assert len(cleaned.faces) == 12


@given(seed=seeds, exponent=st.floats(0, 12))
def test_slivers_are_kept_and_rounded_lines_removed(seed, exponent) -> None:
    rng = np.random.default_rng(seed)
    thin = sliver(10.0**exponent, rng)
    line = np.array([thin[0], thin[1], (thin[0] + thin[1]) / 2])
    report = clean_mesh(Mesh.bare(np.vstack([thin, line]), [[0, 1, 2], [3, 4, 5]]), 10)[1]
    assert report.degenerate_faces == 1
    assert 10.0**-exponent > MIN_FLATNESS


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_clean_mesh_rejects_vertices_that_are_not_finite(bad) -> None:
    vertices = BOX.vertices.copy()
    vertices[0, 1] = bad
    mesh = Mesh.bare(vertices, BOX.faces)
    with pytest.raises(InvalidInput, match="1 of 8 vertices are NaN"):
        clean_mesh(mesh, 100)
    with pytest.raises(InvalidInput, match="1 of 8 vertices are NaN"):
        normalise_mesh(mesh, up="z", diagonal=0.5)
    with pytest.raises(InvalidInput, match="of 36 corners of faces are NaN"):
        sample_exterior(mesh, 10, np.random.default_rng(0))


def test_minus_zero_and_zero_are_the_same_position() -> None:
    places = number_positions(np.array([[0.0, 1, 2], [-0.0, 1, 2], [0.0, 1, 3]]))
    assert places[0] == places[1] != places[2]

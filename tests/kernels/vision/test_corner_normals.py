"""Shading normals against a slow twin, and of badly shaped meshes."""

import numpy as np
import pytest

from pipeline.kernels.vision import primitives as module
from pipeline.kernels.vision.primitives import corner_normals
from tests.kernels.vision.shapes import CENTRE, ball, box, half_turned
from tests.references.slow_corner_normals import slow_corner_normals


def test_corner_normals_equal_the_slow_twins() -> None:
    mesh = half_turned(ball(subdivisions=1))
    soup = mesh.vertices[mesh.faces].reshape(-1, 3)  # every corner its own vertex
    faces = np.arange(len(soup), dtype=np.int32).reshape(-1, 3)
    assert corner_normals(soup, faces) == pytest.approx(slow_corner_normals(soup, faces, module.CREASE), abs=1e-12)


def test_ball_is_smooth_and_box_has_edges() -> None:
    mesh = ball(subdivisions=3)
    outward = mesh.vertices[mesh.faces] - CENTRE
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    assert np.einsum("fci,fci->fc", corner_normals(mesh.vertices, mesh.faces), outward).min() > 0.9999
    edged = box()
    normals = corner_normals(edged.vertices, edged.faces)
    assert normals == pytest.approx(np.repeat(normals[:, :1], 3, axis=1), abs=1e-12)


def test_hubs_and_faces_without_area_have_unit_normals() -> None:
    ring = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    vertices = np.vstack([[0, 0, 1.0], np.column_stack([np.cos(ring), np.sin(ring), 0 * ring])])
    faces = np.column_stack([np.zeros(1000), np.arange(1000) + 1, np.roll(np.arange(1000) + 1, -1)]).astype(np.int32)
    faces = np.vstack([faces, [[1, 1, 2]]]).astype(np.int32)
    normals = corner_normals(vertices, faces)
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(np.ones((1001, 3)))
    assert (normals[:-1, :, 2] > 0.7).all()


def test_faces_without_area_influence_no_normal() -> None:
    """A roof of two gentle slopes, with a line and a point on it that would pull its normals to +z."""
    roof = np.array([[0, -1, 0], [0, 1, 0], [1, 0, -0.2], [-1, 0, -0.4], [0, 0, 0], [0, -2, 0]])
    slopes = np.array([[0, 2, 1], [1, 3, 0]], np.int32)
    flat = np.array([[4, 0, 5], [1, 1, 1], [0, 0, 1]], np.int32)  # the angle of the first, at 0, is two right ones
    np.testing.assert_array_equal(corner_normals(roof, np.vstack([slopes, flat]))[:2], corner_normals(roof, slopes))
    assert (np.linalg.norm(corner_normals(roof, flat), axis=2) == 1).all()


def test_corner_normals_of_no_faces_are_empty() -> None:
    assert corner_normals(np.zeros((0, 3)), np.zeros((0, 3), np.int32)).shape == (0, 3, 3)

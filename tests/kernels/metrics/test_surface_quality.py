"""Measures of surface quality on simple shapes."""

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.kernels.metrics.surface_quality import (
    crossing_faces,
    dihedral_angles,
    intersection_over_union,
    normal_consistency,
    seam_gaps,
    surface_area,
)

BOX = trimesh.creation.box((2.0, 3.0, 4.0))
BALL = trimesh.creation.icosphere(subdivisions=3)


def test_area_and_angles_of_a_box():
    assert surface_area(BOX.vertices, BOX.faces) == pytest.approx(2 * (6 + 8 + 12))
    angles = np.sort(dihedral_angles(BOX.vertices, BOX.faces))  # six diagonals in the sides, twelve edges
    assert angles == pytest.approx([0.0] * 6 + [90.0] * 12, abs=1e-9)


def test_fold_has_180_degrees_and_face_without_area_has_no_angle():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, 0.9, 0], [2, 0, 0]], float)
    assert dihedral_angles(vertices, np.array([[0, 1, 2], [1, 0, 3]])) == pytest.approx([180.0])
    assert len(dihedral_angles(vertices, np.array([[0, 1, 2], [1, 0, 4]]))) == 0


def test_seam_gap_is_measured_between_vertices_of_the_same_position():
    vertices = np.array([[0, 0, 0], [0, 0, 3], [1, 1, 1], [0, 4, 0], [5, 5, 5], [5, 5, 5]], float)
    assert seam_gaps(vertices, np.array([7, 7, 1, 7, 2, 2])) == pytest.approx([0.0, 5.0])


def test_normal_consistency_is_one_for_either_sign_and_half_for_random_normals(rng):
    points, face_index = trimesh.sample.sample_surface(BALL, 4000, seed=0)
    normals = BALL.face_normals[face_index]
    distances = cloud_distances(points, points)
    assert normal_consistency(normals, -normals, distances) == pytest.approx(1.0)
    random = rng.standard_normal((4000, 3))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    assert normal_consistency(normals, random, distances) == pytest.approx(0.5, abs=0.02)
    turned = np.cross(normals, np.roll(normals, 1, axis=1))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    assert normal_consistency(normals, turned, distances) == pytest.approx(0.0, abs=1e-3)


def test_large_face_crosses_each_small_face_that_it_intersects():
    ball = trimesh.creation.icosphere(6)
    vertices = np.concatenate([ball.vertices, [[-9, -9, 0.01], [9, -9, 0.01], [0, 9, 0.01]]])
    crossing = crossing_faces(vertices, np.concatenate([ball.faces, [len(ball.vertices) + np.arange(3)]]))
    heights = ball.vertices[ball.faces][:, :, 2] > 0.01
    assert crossing[-1]
    assert (crossing[:-1] == (heights.any(axis=1) & ~heights.all(axis=1))).all()


def test_shared_volume_of_two_boxes(rng):
    other = BOX.copy()
    other.apply_translation([1.0, 0, 0])
    points = rng.uniform(-2.5, 2.5, (40_000, 3))
    shared = intersection_over_union((BOX.vertices, BOX.faces), (other.vertices, other.faces), points)
    assert shared == pytest.approx(1 / 3, abs=0.02)
    assert intersection_over_union((BOX.vertices, BOX.faces), (other.vertices, other.faces[:, ::-1]), points) == shared, "wound inwards"
    with pytest.raises(InvalidInput, match="none of 5 points is inside either"):
        intersection_over_union((BOX.vertices, BOX.faces), (other.vertices, other.faces), points[:5] + 100)

"""Signed distances against closed forms, and sampling around a surface."""

import numpy as np
import pytest
import trimesh

from pipeline.kernels.geometry.signed_distance import rms_distance_to_surface, sample_around_surface, signed_distances
from tests.references.box_distance import box_distance

BALL = trimesh.creation.icosphere(subdivisions=5)
SIDES = np.array([0.2, 0.4, 0.6])
BOX = trimesh.creation.box(SIDES)


def points(count: int, reach: float) -> np.ndarray:
    return np.random.default_rng(0).uniform(-reach, reach, (count, 3))


def test_distances_to_a_ball_equal_the_closed_form():
    queries = points(2000, 2.0)
    distances = signed_distances(queries, BALL.vertices, BALL.faces)
    assert np.abs(distances - (np.linalg.norm(queries, axis=1) - 1)).max() < 1e-3  # a chord's height
    assert (distances < 0).sum() > 100


def test_distances_to_a_box_are_exact():
    queries = points(2000, 0.5)
    np.testing.assert_allclose(signed_distances(queries, BOX.vertices, BOX.faces), box_distance(queries, SIDES), atol=1e-12)


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_faces_wound_against_their_neighbours_change_nothing(share):
    queries, turned = points(500, 1.2), np.random.default_rng(1).random(len(BALL.faces)) < share
    two = trimesh.util.concatenate([BALL, BALL.copy().apply_translation([3, 0, 0])])  # a part of its own, which agrees
    faces = np.where(np.append(turned, np.zeros_like(turned))[:, None], two.faces[:, ::-1], two.faces)
    expected = signed_distances(queries, two.vertices, two.faces)
    np.testing.assert_allclose(signed_distances(queries, two.vertices, faces), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("turned", [(False, True), (True, False), (True, True)])
def test_parts_that_overlap_may_be_wound_against_each_other(turned):
    queries = points(500, 1.5)
    parts = [BALL, BALL.copy().apply_translation([1.3, 0, 0])]
    expected = signed_distances(queries, *_joined(parts, (False, False)))
    np.testing.assert_allclose(signed_distances(queries, *_joined(parts, turned)), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shift", [0.0, 0.1, 1 / 3])  # the sum of the volumes is 0, or is rounding
def test_overlap_of_a_half_and_its_mirror_image_is_inside(shift):
    half = BALL.copy().apply_translation([0.65, 0, 0])
    vertices = np.concatenate([half.vertices, half.vertices * [-1, 1, 1]]) + shift
    faces = np.concatenate([half.faces, half.faces + len(half.vertices)])
    right = np.concatenate([half.faces, half.faces[:, ::-1] + len(half.vertices)])
    queries = points(500, 1.5)
    np.testing.assert_allclose(signed_distances(queries, vertices, faces), signed_distances(queries, vertices, right), rtol=0, atol=1e-12)
    assert signed_distances(np.full((1, 3), shift), vertices, faces)[0] < 0


@pytest.mark.parametrize("turned", [(False, True), (True, False)])
def test_a_closed_part_within_another_that_is_wound_against_it_is_a_cavity(turned):
    queries = points(500, 1.2)
    distances = signed_distances(queries, *_joined([BALL, BALL.copy().apply_scale(0.5)], turned))
    radii = np.linalg.norm(queries, axis=1)
    np.testing.assert_allclose(distances, np.abs(radii - 0.75) - 0.25, atol=1e-3)


def _joined(parts, turned):
    """Join parts to vertices and faces, some of them turned inside out."""
    joined = trimesh.util.concatenate(parts)
    against = np.repeat(turned, [len(part.faces) for part in parts])[:, None]
    return joined.vertices, np.where(against, joined.faces[:, ::-1], joined.faces)


def test_sign_in_an_open_box_follows_the_solid_angle():
    """Seen from height h above or below its middle, the lid fills 4 asin(a b / sqrt((a² + h²) (b² + h²))): less than half of all around."""
    faces = BOX.faces[BOX.triangles_center[:, 2] < 0.29]
    assert len(faces) == 10
    heights = np.array([-0.02, -1e-3, 1e-3, 0.02])
    distances = signed_distances(np.array([0, 0, 0.3]) + heights[:, None] * [0, 0, 1], BOX.vertices, faces)
    np.testing.assert_allclose(distances, np.sign(heights) * np.hypot(0.1, np.maximum(heights, 0)), atol=1e-9)


def test_both_sides_of_a_sheet_are_outside_and_overlap_of_parts_is_inside():
    sheet = signed_distances(np.array([[0.2, 0.2, 1e-3], [0.2, 0.2, -1e-3]]), np.eye(3) * [1, 1, 0], np.array([[0, 1, 2]]))
    assert sheet == pytest.approx([1e-3, 1e-3])
    two = trimesh.util.concatenate([BOX, BOX.copy().apply_translation([0.15, 0, 0])])
    both = signed_distances(np.array([[0.075, 0, 0], [0.19, 0, 0], [0.26, 0, 0]]), two.vertices, two.faces)
    assert both == pytest.approx([-0.025, -0.06, 0.01])


def test_points_are_drawn_near_the_surface_and_around_it():
    surface = BALL.vertices + [5.0, 0, 0]
    drawn = sample_around_surface(surface, 4000, np.random.default_rng(1), near=0.75, spread=(1e-3, 1e-2), reach=3.0) - [5.0, 0, 0]
    apart = np.abs(np.linalg.norm(drawn, axis=1) - 1)
    assert drawn.shape == (4000, 3)
    assert np.abs(drawn).max() <= 3.0
    # 3000 near, of which nearly none is 5 cm off; the shell of 5 cm to both sides has 0.6 % of the cube
    assert abs((apart < 0.05).sum() - 3000 - 1000 * 1.26 / 216) < 20
    assert 0.25 < (apart[apart < 0.05] < 1.5e-3).mean() < 0.45  # log-uniform: about a third
    halves = [(apart[part] < 0.05).mean() for part in (slice(2000), slice(2000, None))]
    assert halves[0] == pytest.approx(halves[1], abs=0.05)  # in random order


@pytest.mark.parametrize(
    ("measure", "queries", "vertices", "faces", "named"),
    [
        (signed_distances, np.zeros((1, 3)), np.eye(3), np.zeros((0, 3), int), "faces"),
        (rms_distance_to_surface, np.zeros((0, 3)), np.eye(3), np.array([[0, 1, 2]]), "0 points and 1 faces"),
        (rms_distance_to_surface, np.zeros((2, 3)), np.eye(3), np.zeros((0, 3), int), "2 points and 0 faces"),
        (rms_distance_to_surface, np.full((2, 3), np.inf), np.eye(3), np.array([[0, 1, 2]]), "points"),
        (rms_distance_to_surface, np.zeros((2, 3)), np.full((3, 3), np.nan), np.array([[0, 1, 2]]), "vertices"),
    ],
)
def test_distances_reject_missing_faces_and_points_that_are_not_finite(measure, queries, vertices, faces, named):
    with pytest.raises(ValueError, match=named):
        measure(queries, vertices, faces)

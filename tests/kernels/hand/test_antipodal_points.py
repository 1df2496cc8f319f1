"""Opposed points of a box and a ball, where they are known."""

import numpy as np
import trimesh

from pipeline.kernels.hand.distance_field import build_distance_field
from pipeline.kernels.hand.pinches import antipodal_points, central_weights
from tests.kernels.hand.meshes import centred, points_on

CENTRE = np.array([0, 0, 0.6])


def test_opposed_points_of_a_box_lie_on_opposite_faces() -> None:
    sides = np.array([0.02, 0.06, 0.2])
    box = centred(trimesh.creation.box(sides))
    field = build_distance_field(box.vertices, box.faces, cell=0.005, band=0.03)
    pairs = antipodal_points(field, *points_on(box, 1000, seed=0), friction=0.5, widest=0.1, rng=np.random.default_rng(0))
    assert len(pairs.width) > 500
    ends = [np.abs(pairs.centre + side * pairs.width[:, None] / 2 * pairs.axis - CENTRE) for side in (-1, 1)]
    faces = [(np.abs(end - sides / 2) < 1e-6).argmax(axis=1) for end in ends]
    np.testing.assert_array_equal(*faces)
    assert set(faces[0]) == {0, 1}  # not across the length, which is wider than asked for
    along = np.abs(pairs.axis[np.arange(len(pairs.width)), faces[0]])
    assert (along >= np.cos(0.8 * np.arctan(0.5)) - 1e-9).all()
    np.testing.assert_allclose(pairs.width * along, sides[faces[0]], rtol=1e-5)


def test_opposed_points_of_a_ball_lie_across_its_centre_with_most_weight_on_the_nearest() -> None:
    ball = centred(trimesh.creation.icosphere(subdivisions=4, radius=0.03))
    field = build_distance_field(ball.vertices, ball.faces, cell=0.005, band=0.03)
    pairs = antipodal_points(field, *points_on(ball, 1000, seed=0), friction=0.5, widest=0.1, rng=np.random.default_rng(0))
    off = np.linalg.norm(pairs.centre - CENTRE, axis=1)
    assert off.max() < 0.03 * np.sin(0.8 * np.arctan(0.5)) + 1e-3
    beside = CENTRE + [0.1, 0, 0]
    weights = central_weights(pairs, beside, spread=0.05)
    nearest = np.argsort(np.linalg.norm(pairs.centre - beside, axis=1))
    assert abs(weights.sum() - 1) < 1e-12
    assert (np.diff(weights[nearest]) <= 0).all()
    assert len(antipodal_points(field, *points_on(ball, 50, seed=0), friction=0.5, widest=0.01, rng=np.random.default_rng(0)).width) == 0

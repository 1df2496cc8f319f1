"""Level-set meshes of fields with known surfaces."""

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry import level_set
from pipeline.kernels.geometry.level_set import level_set_mesh

RADIUS, BALL = 0.1, 4 / 3 * np.pi * 0.1**3


def ball(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - [1.0, 0, 0], axis=1) - RADIUS


def mesh_of(field, low, high, spacing, **options) -> trimesh.Trimesh:
    return trimesh.Trimesh(*level_set_mesh(field, np.array(low), np.array(high), spacing, **options), process=False)


@pytest.mark.parametrize("halvings", [0, 1, 3])
def test_level_set_of_a_signed_distance_is_the_ball(halvings):
    mesh = mesh_of(ball, [0.88, -0.12, -0.11], [1.13, 0.12, 0.12], 0.005, halvings=halvings)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert np.abs(ball(mesh.vertices)).max() < 0.005**2 / (2 * RADIUS)  # a chord's height
    assert mesh.volume == pytest.approx(BALL, rel=0.005)


def test_field_is_computed_near_the_surface_only():
    asked = []

    def counted(points):
        asked.append(len(points))
        return ball(points)

    everywhere, near = (mesh_of(counted, [0.8, -0.2, -0.2], [1.2, 0.2, 0.2], 0.005, halvings=halvings).vertices for halvings in (0, 3))
    np.testing.assert_allclose(near, everywhere, atol=1e-12)
    assert sum(asked[1:]) < asked[0] / 6


def test_a_flat_field_is_computed_at_fewer_points_and_has_the_same_surface(monkeypatch):
    asked = []

    def flat(points):  # as a network's distances, a fifth as steep as true ones
        asked.append(len(points))
        return ball(points) / 5

    box, counts, meshes = ([0.8, -0.2, -0.2], [1.2, 0.2, 0.2], 0.005), [], []
    for steeper in (level_set.STEEPER, 1e9):  # the latter takes any field to be as steep as a distance
        monkeypatch.setattr(level_set, "STEEPER", steeper)
        asked.clear()
        meshes.append(mesh_of(flat, *box, halvings=3).vertices)
        counts.append(sum(asked))
    np.testing.assert_allclose(*meshes, atol=1e-12)
    assert counts[0] < counts[1] * 2 / 3


def test_parts_thinner_than_a_cell_are_as_if_the_field_were_computed_everywhere():
    """A plate aslant and balls of half a cell to two cells, at random places."""
    rng = np.random.default_rng(0)
    normal, middles, radii = np.array([0.36, 0.48, 0.8]), rng.uniform(-0.15, 0.15, (12, 3)), rng.uniform(0.0025, 0.01, 12)

    def field(points):
        plate = np.maximum(np.abs(points @ normal) - 0.0035, np.linalg.norm(points, axis=1) - 0.12)
        balls = np.linalg.norm(points[:, None] - middles, axis=2) - radii
        return np.minimum(plate, balls.min(axis=1))

    low, high = np.full(3, -0.2), np.full(3, 0.2)
    (near, sides), (everywhere, all_sides) = (level_set_mesh(field, low, high, 0.005, halvings=halvings) for halvings in (3, 0))
    np.testing.assert_allclose(near, everywhere, atol=1e-12)
    np.testing.assert_array_equal(sides, all_sides)
    assert len(trimesh.Trimesh(near, sides, process=False).split()) > 8


def test_field_is_computed_at_small_parts_where_it_is_steep():
    """A small ball beside a large one, steeper than the field elsewhere."""
    small = np.array([1.0, 0, 0.163])

    def field(points):
        beside = np.linalg.norm(points - small, axis=1)
        return 5 * np.where(beside < 0.02, 10 * (beside - 0.008), ball(points).clip(0.05))

    box, options = ([0.8, -0.2, -0.2], [1.2, 0.2, 0.2], 0.004), {"halvings": 3}
    assert mesh_of(field, *box, **options).is_empty
    found = mesh_of(field, *box, **options, dense_points=small[None], dense_radius=0.01)
    assert found.is_watertight
    assert found.volume == pytest.approx(4 / 3 * np.pi * 0.008**3, rel=0.2)


@pytest.mark.parametrize("halvings", [0, 3])
def test_smaller_pieces_are_left_out_unless_a_point_is_near_them(halvings):
    small = np.array([1.0, 0, 0.16])

    def field(points):  # a ball with a hollow, and a small one beside it
        shell = np.maximum(ball(points), 0.06 - np.linalg.norm(points - [1.0, 0, 0], axis=1))
        return np.minimum(shell, np.linalg.norm(points - small, axis=1) - 0.02)

    box, options = ([0.8, -0.2, -0.2], [1.2, 0.2, 0.2], 0.005), {"halvings": halvings}
    felt = small + [0.02, 0, 0]
    pieces = [
        len(mesh_of(field, *box, **options, **chosen).split(only_watertight=False))
        for chosen in ({}, {"loose_pieces": False}, {"loose_pieces": False, "dense_points": felt[None], "dense_radius": 0.01})
    ]
    assert pieces == [3, 2, 3]  # the hollow's wall is a surface too
    alone = mesh_of(field, *box, **options, loose_pieces=False)
    assert alone.is_watertight
    assert alone.volume == pytest.approx(BALL * (1 - 0.6**3), rel=0.01)


def test_any_field_gives_a_closed_mesh_that_stays_closed_in_float32():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(12, 12, 12)).round(1)  # a tenth of the differences, and many values, are 0
    mesh = mesh_of(lambda points: noise[tuple(np.round(10 * points).astype(int).T)], [0, 0, 0], [1.1, 1.1, 1.1], 0.1, halvings=0)
    assert (noise == 0).sum() > 20
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx((noise < 0).sum() * 1e-3, rel=0.2)
    welded = trimesh.Trimesh(mesh.vertices.astype(np.float32), mesh.faces)  # merges equal vertices
    assert welded.is_watertight
    assert len(welded.vertices) == len(mesh.vertices)


def test_an_empty_field_gives_an_empty_mesh():
    vertices, faces = level_set_mesh(lambda points: np.ones(len(points)), np.zeros(3), np.ones(3), 0.1)
    assert vertices.shape == faces.shape == (0, 3)


@pytest.mark.parametrize(
    ("field", "high", "spacing", "words"),
    [
        (ball, [1.0, 0.0, 1.0], 0.1, "is empty"),
        (ball, [1.0, 1.0, np.inf], 0.1, "is empty"),
        (ball, [1.0, 1.0, 1.0], -0.1, "is empty"),
        (ball, [1.0, 1.0, 1.0], 1e-4, r"1e\+12 cells, more than 134217728"),
        (lambda points: np.where(points[:, 0] > 0.5, np.nan, 1.0), [1.0, 1.0, 1.0], 0.5, "NaN or infinite at"),
    ],
)
def test_level_set_rejects_invalid_fields_and_boxes(field, high, spacing, words):
    with pytest.raises(InvalidInput, match=words):
        level_set_mesh(field, np.zeros(3), np.array(high), spacing)


def test_neighbourhoods_larger_than_the_grid_are_computed_in_its_memory():
    """Without the memory limit, 2e9 offsets of one position would be listed."""
    far = np.array([[5.0, 0, 0], [1.0, 0, 0.05]])
    asked = []

    def counted(points):
        asked.append(len(points))
        return ball(points)

    mesh_of(counted, [0.8, -0.2, -0.2], [1.2, 0.2, 0.2], 0.01, halvings=1, dense_points=far, dense_radius=6.0)
    assert asked == [21**3, 41**3]

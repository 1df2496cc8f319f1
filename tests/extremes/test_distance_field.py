"""Distances to objects of any size and place, to slivers, sheets and soups of faces; and how far the grid may be off them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import strategies as st

from pipeline.kernels.hand import distance
from pipeline.kernels.hand.bodies import Balls
from pipeline.kernels.hand.clearance import deepest
from pipeline.kernels.hand.distance import SLIVER, DistanceField, distance_field
from tests.extremes.profile import at_size, for_all
from tests.extremes.strategies import EPS, aspects, offsets, scales, seeds, sliver, turn

CELL, BAND = 0.02, 0.05
SIDES = np.array([0.2, 0.3, 0.16])
BOX = trimesh.creation.box(SIDES)
AROUND = np.random.default_rng(0).uniform(-0.3, 0.3, (300, 3))


def to_box(points: np.ndarray, sides: np.ndarray = SIDES) -> np.ndarray:
    """Signed distance to a box around the origin."""
    beyond = np.abs(points) - sides / 2
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


@for_all(few=6, many=200, seed=seeds, scale=scales, offset=offsets)
def test_a_box_of_any_size_anywhere(seed, scale, offset) -> None:
    """Turned, with faces doubled and wound anyhow, and some without area."""
    rng = np.random.default_rng(seed)
    rotation = turn(rng)
    faces = np.vstack([BOX.faces, BOX.faces[rng.random(12) < 0.5], [[0, 0, 1], [2, 2, 2]]])
    faces = np.array([rng.permutation(face) for face in faces])
    field = distance_field(BOX.vertices @ rotation.T * scale + offset, faces, CELL * scale, BAND * scale)
    found = field.exact(AROUND @ rotation.T * scale + offset) / scale
    assert np.abs(found - to_box(AROUND)).max() <= 16 * EPS * (np.abs(offset).max() / scale + 1)


@pytest.fixture
def small_memory(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(distance, "MAX_CELLS", 60_000)
    return 60_000


@pytest.mark.parametrize("size", [0.1, 0.5, 3, 10, 1e3, 1e6])
def test_an_object_too_large_for_its_cells_gets_larger_ones_and_keeps_its_sides(size, small_memory) -> None:
    """A grid whose rim is narrower than its cells does not know what is outside."""
    field = distance_field(BOX.vertices * size / 0.3, BOX.faces, 0.005, 0.01)
    points = AROUND * size / 0.3
    expected = to_box(points, SIDES * size / 0.3)
    np.testing.assert_allclose(field.exact(points), expected, atol=1e-14 * size)
    far = np.abs(expected) > 2 * field.cell
    np.testing.assert_array_equal(np.sign(field.lookup(points.T.astype(np.float32)))[far], np.sign(expected)[far])
    assert len(field.records) <= small_memory


@pytest.mark.parametrize("extent", [(0.3, 0.3, 0.0), (1e3, 0.0, 0.0), (1e3, 1e3, 0.001)])
def test_no_shape_of_object_fills_the_memory(extent, small_memory) -> None:
    """Sheets, lines and large plates: their cells round up along three axes."""
    x, y, z = extent
    vertices = np.array([[0, 0, 0], [x, y / 2, 0], [x, y, z], [0, y, z]])
    assert len(distance_field(vertices, np.array([[0, 1, 2], [0, 2, 3]]), 0.005, 0.01).records) <= small_memory


@for_all(few=30, many=1000, seed=seeds, aspect=aspects)
def test_distance_to_a_sliver_is_as_exact_as_stated(seed, aspect) -> None:
    rng = np.random.default_rng(seed)
    face = sliver(aspect, rng)
    field = distance_field(face, np.array([[0, 1, 2]]), 0.1, 0.2)
    normal = np.cross(face[1] - face[0], face[2] - face[0])
    normal /= np.linalg.norm(normal)
    on_face = rng.dirichlet([1, 1, 1], 50) @ face
    height = rng.uniform(0, 0.01, 50)
    allowed = 2e-15 if aspect < 10 else 1e-11 if aspect < 1e3 else 4e-6
    assert np.abs(field.exact(on_face + height[:, None] * normal) - height).max() <= allowed


def test_a_sliver_is_the_edge_opposite_its_middle_corner() -> None:
    corners = np.array([[0, 0, 0], [0.4, SLIVER / 4, 0], [1, 0, 0], [0, 1, 0]])
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]):
        field = distance_field(corners, np.array([order, [0, 2, 3]]), 0.1, 0.2)
        assert set(field.faces[0].tolist()) == {0, 2}
        assert field.faces[1].tolist() == [0, 2, 3]


@pytest.mark.parametrize(
    "faces", [[[0, 1, 2]], [[0, 1, 2], [0, 2, 1]], [[0, 1, 2], [0, 1, 3], [1, 2, 3]]], ids=["one", "both ways", "open"]
)
def test_sheets_have_no_inside(faces) -> None:
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0.1, 0.1, 0.2]])
    assert (distance_field(corners, np.array(faces), CELL, BAND).exact(AROUND) >= 0).all()


def spiky(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    if kind == "cone":
        body = trimesh.creation.cone(0.1 * CELL, 8 * CELL)
        return body.vertices @ turn(rng).T, body.faces
    if kind == "triangle":
        return rng.normal(size=(3, 3)) * 3 * CELL, np.array([[0, 1, 2]])
    if kind in ("plate", "thin plate"):
        body = trimesh.creation.box((9 * CELL, (3 if kind == "plate" else rng.uniform(0.5, 3)) * CELL, 6 * CELL))
        return body.vertices @ turn(rng).T, body.faces
    faces = rng.integers(0, 9, (12, 3))
    return rng.normal(size=(9, 3)) * 3 * CELL, faces[[len(set(face)) == 3 for face in faces.tolist()]]


@pytest.mark.parametrize("kind", ["cone", "triangle", "plate", "thin plate", "soup"])
@for_all(few=3, many=100, seed=seeds)
def test_a_look_up_errs_by_two_cells_at_most(kind, seed) -> None:
    """Edges, tips, sheets and parts thinner than a cell, all within the grid's band; and on the right side from 3 cells on."""
    rng = np.random.default_rng(seed)
    vertices, faces = spiky(kind, rng)
    field = distance_field(vertices, faces, CELL, BAND)
    corners = vertices[faces[rng.integers(0, len(faces), 4000)]]
    points = (corners * rng.dirichlet([1, 1, 1], 4000)[..., None]).sum(axis=1) + rng.normal(size=(4000, 3)) * CELL
    exact, seen = field.exact(points), field.lookup(points.T.astype(np.float32))
    near = np.abs(exact) < BAND - CELL
    assert np.abs(np.abs(seen) - np.abs(exact))[near].max() <= 1.8 * CELL
    assert seen[exact < 0].max(initial=-np.inf) <= 2 * CELL
    if kind == "plate":
        assert np.abs(seen - exact)[near].max() <= 1.8 * CELL


@at_size("attitudes", few=6, many=100)
def test_no_depth_in_a_thin_part_is_overlooked(attitudes, rng) -> None:
    """The grid takes points in a plate for points beside it; they are measured all the same."""
    mistaken = 0
    for _ in range(attitudes):
        body = trimesh.creation.box((9 * CELL, 2 * CELL, 6 * CELL))
        field = distance_field(body.vertices @ turn(rng).T, body.faces, CELL, BAND)
        points = rng.dirichlet([1] * 8, 1000) @ field.vertices
        exact, seen = field.exact(points), field.lookup(points.T.astype(np.float32))
        worst = int(np.where(exact < 0, seen, -np.inf).argmax())
        ball = Balls(points[[worst]], np.zeros(1), np.zeros(1, np.intp))
        assert deepest(field, ball, np.eye(4)[None]) == pytest.approx(max(0, -exact[worst]), abs=1e-12)
        mistaken += bool(seen[worst] > CELL / 4)
    assert mistaken > 0


@for_all(few=4, many=100, offset=offsets, exponent=st.integers(-3, 0))
def test_float32_coordinates_cost_a_look_up_what_is_stated(offset, exponent) -> None:
    """Over the middle of a face, where first order is exact; with no offset, centres of cells lie on the face itself."""
    points = AROUND * [0.15, 0.3, 0.02] + [0, 0, SIDES[2] / 2]
    for place in (np.zeros(3), offset * 10.0**exponent):
        seen = distance_field(BOX.vertices + place, BOX.faces, CELL, BAND).lookup((points + place).T.astype(np.float32))
        assert np.abs(seen - to_box(points)).max() <= 2.0**-21 * (np.abs(place).max() + 1)


def test_points_that_are_none_and_meshes_that_are_none() -> None:
    field: DistanceField = distance_field(BOX.vertices, BOX.faces, CELL, BAND)
    assert field.exact(np.zeros((0, 3))).shape == (0,)
    assert field.lookup(np.zeros((3, 0), np.float32)).shape == (0,)
    assert (field.lookup(np.array([[np.inf], [-np.inf], [0]], np.float32)) > 0).all()  # the grid's rim
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match="NaN or infinite"):
            field.exact(np.array([[0, bad, 0]]))
        with pytest.raises(ValueError, match="gate it first"):
            distance_field(BOX.vertices + bad, BOX.faces, CELL, BAND)
    with pytest.raises(ValueError, match="mesh of 0 faces"):
        distance_field(BOX.vertices, np.zeros((0, 3)), CELL, BAND)

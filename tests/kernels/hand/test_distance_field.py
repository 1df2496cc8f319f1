"""Signed distance fields, the error of their grids, and distances of a hand from planes and blocks, where they are known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import SLIVER_FLATNESS, Mesh
from pipeline.kernels.hand import distance_field
from pipeline.kernels.hand.collision_shapes import CollisionSpheres, collision_spheres
from pipeline.kernels.hand.distance_field import (
    DistanceField,
    build_distance_field,
    finger_clearance,
    gel_contact,
    gel_grid,
    gel_probes,
    near_gaps,
    penetration_depth,
)
from pipeline.kernels.hand.grasp_ik import prepare_grasp_ik
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.pregrasp import tangent_palm_pose
from tests.kernels.hand.meshes import centred, mug, random_pose
from tests.references.box_distance import box_distance
from tests.references.world_centres import world_centres
from tests.strategies import random_rotation, seeds

FINE = 0.0025
CELL, BAND = 0.02, 0.05
SIDES = np.array([0.2, 0.3, 0.16])
BOX = trimesh.creation.box(SIDES)
AROUND = np.random.default_rng(0).uniform(-0.3, 0.3, (300, 3))


def field_of(mesh: Mesh) -> DistanceField:
    return build_distance_field(mesh.vertices, mesh.faces, cell=FINE, band=0.012)


def around(mesh: Mesh, rng: np.random.Generator, count: int = 20_000) -> np.ndarray:
    return rng.uniform(mesh.vertices.min(axis=0) - 0.01, mesh.vertices.max(axis=0) + 0.01, (count, 3))


@pytest.mark.parametrize("inside_out", [False, True])
def test_exact_distance_to_a_box_wound_either_way(rng: np.random.Generator, inside_out: bool) -> None:
    mesh = centred(trimesh.creation.box((0.1, 0.16, 0.3)))
    if inside_out:
        mesh = Mesh.bare(mesh.vertices, mesh.faces[:, ::-1])
    points = around(mesh, rng)
    np.testing.assert_allclose(field_of(mesh).exact(points), box_distance(points, np.array([0.1, 0.16, 0.3]), (0, 0, 0.6)), atol=1e-12)


def test_lookup_is_first_order_in_its_band_and_a_lower_bound_beyond(rng: np.random.Generator) -> None:
    mesh = centred(trimesh.creation.icosphere(subdivisions=4, radius=0.1))
    field, points = field_of(mesh), around(mesh, rng)
    exact = field.exact(points)
    approx = field.lookup(points.T.astype(np.float32))
    near = np.abs(exact) < 0.012
    assert np.abs(approx - exact)[near].max() < FINE / 10
    far = exact > 0.015
    assert (approx[far] <= exact[far] + 1e-6).all()
    assert (approx[far] > 0.01).all()


def test_inside_of_an_open_cup_is_outside_the_object() -> None:
    field = field_of(mug())
    centre = mug().vertices[:, 0].min() + 0.09  # the cup's axis
    assert field.exact(np.array([[centre, 0.0, 0.6]]))[0] == pytest.approx(0.084, abs=3e-4)  # a polygon of 48 sides


@pytest.fixture
def small_memory(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(distance_field, "MAX_CELLS", 60_000)
    return 60_000


@pytest.mark.parametrize("size", [0.1, 0.5, 3, 10, 1e3])
def test_enlarged_cells_keep_the_sign(size, small_memory) -> None:
    """The margin grows with the cells: the grid's corner is known to be outside, and points off the grid are not taken for near ones."""
    field = build_distance_field(BOX.vertices * size / 0.3, BOX.faces, cell=0.005, band=0.01)
    points = AROUND * size / 0.3
    expected = box_distance(points, SIDES * size / 0.3)
    np.testing.assert_allclose(field.exact(points), expected, atol=1e-14 * size)
    far = np.abs(expected) > 2 * field.cell
    np.testing.assert_array_equal(np.sign(field.lookup(points.T.astype(np.float32)))[far], np.sign(expected)[far])
    assert (field.lookup(10 * points.T.astype(np.float32))[np.abs(AROUND).max(axis=1) > 0.1] > 0.01).all()
    assert field.inside.size <= small_memory


@pytest.mark.parametrize("extent", [(0.3, 0.3, 0.0), (1e3, 0.0, 0.0), (1e3, 1e3, 0.001)])
def test_cells_are_limited_for_sheets_lines_and_plates(extent, small_memory) -> None:
    """Their numbers of cells round up along three axes."""
    x, y, z = extent
    vertices = np.array([[0, 0, 0], [x, y / 2, 0], [x, y, z], [0, y, z]])
    field = build_distance_field(vertices, np.array([[0, 1, 2], [0, 2, 3]]), cell=0.005, band=0.01)
    assert field.inside.size <= small_memory


def test_sliver_is_replaced_by_the_edge_opposite_its_middle_corner() -> None:
    corners = np.array([[0, 0, 0], [0.4, SLIVER_FLATNESS / 4, 0], [1, 0, 0], [0, 1, 0]])
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]):
        field = build_distance_field(corners, np.array([order, [0, 2, 3]]), cell=0.1, band=0.2)
        assert set(field.faces[0].tolist()) == {0, 2}
        assert field.faces[1].tolist() == [0, 2, 3]


@pytest.mark.parametrize(
    "faces", [[[0, 1, 2]], [[0, 1, 2], [0, 2, 1]], [[0, 1, 2], [0, 1, 3], [1, 2, 3]]], ids=["one", "both ways", "open"]
)
def test_open_faces_have_no_inside(faces) -> None:
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0.1, 0.1, 0.2]])
    assert (build_distance_field(corners, np.array(faces), cell=CELL, band=BAND).exact(AROUND) >= 0).all()


def spiky(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    if kind == "cone":
        body = trimesh.creation.cone(0.1 * CELL, 8 * CELL)
        return body.vertices @ random_rotation(rng).T, body.faces
    if kind == "triangle":
        return rng.normal(size=(3, 3)) * 3 * CELL, np.array([[0, 1, 2]])
    if kind in ("plate", "thin plate"):
        body = trimesh.creation.box((9 * CELL, (3 if kind == "plate" else rng.uniform(0.5, 3)) * CELL, 6 * CELL))
        return body.vertices @ random_rotation(rng).T, body.faces
    faces = rng.integers(0, 9, (12, 3))
    return rng.normal(size=(9, 3)) * 3 * CELL, faces[[len(set(face)) == 3 for face in faces.tolist()]]


@pytest.mark.parametrize("kind", ["cone", "triangle", "plate", "thin plate", "soup"])
@given(seed=seeds)
def test_lookup_error_is_at_most_two_cells(kind, seed) -> None:
    """Edges, tips, sheets and parts thinner than a cell, all within the grid's band; and on the right side from 3 cells on."""
    rng = np.random.default_rng(seed)
    vertices, faces = spiky(kind, rng)
    field = build_distance_field(vertices, faces, cell=CELL, band=BAND)
    corners = vertices[faces[rng.integers(0, len(faces), 4000)]]
    points = (corners * rng.dirichlet([1, 1, 1], 4000)[..., None]).sum(axis=1) + rng.normal(size=(4000, 3)) * CELL
    exact, approx = field.exact(points), field.lookup(points.T.astype(np.float32))
    near = np.abs(exact) < BAND - CELL
    assert np.abs(np.abs(approx) - np.abs(exact))[near].max() <= 1.8 * CELL
    assert approx[exact < 0].max(initial=-np.inf) <= 2 * CELL
    if kind == "plate":
        assert np.abs(approx - exact)[near].max() <= 1.8 * CELL


def test_distance_field_accepts_no_points_and_looks_up_infinite_ones_at_its_rim() -> None:
    field = build_distance_field(BOX.vertices, BOX.faces, cell=CELL, band=BAND)
    assert field.exact(np.zeros((0, 3))).shape == (0,)
    assert field.lookup(np.zeros((3, 0), np.float32)).shape == (0,)
    assert (field.lookup(np.array([[np.inf], [-np.inf], [np.nan]], np.float32)) > 0).all()
    with pytest.raises(ValueError, match="NaN"):
        field.exact(np.array([[0, np.inf, 0]]))


@pytest.mark.parametrize(
    ("vertices", "faces", "named"),
    [(BOX.vertices + np.nan, BOX.faces, "NaN"), (BOX.vertices + np.inf, BOX.faces, "NaN"), (BOX.vertices, np.zeros((0, 3)), "0 faces")],
)
def test_distance_field_rejects_missing_faces_and_corners_that_are_not_finite(vertices, faces, named) -> None:
    with pytest.raises(ValueError, match=named):
        build_distance_field(vertices, faces, cell=CELL, band=BAND)


HAND = load_hand("allegro_right")
SENSOR = load_sensor(HAND.sensors[0].sensor)


@given(seed=seeds)
def test_contact_and_clearance_over_a_plane_are_heights(seed) -> None:
    rng = np.random.default_rng(seed)
    base = rng.uniform(-10, 10, 3)
    block = trimesh.creation.box((4.0, 4.0, 4.0)).apply_translation(base - [0, 0, 2.0])
    field = build_distance_field(block.vertices, block.faces, cell=0.3, band=0.6)
    frames = forward_kinematics(HAND, random_pose(rng, base + [0, 0, 0.1])[None], rng.uniform(HAND.lower, HAND.upper)[None])
    spheres = collision_spheres(HAND, spacing=0.02)
    fingers, grid = [spheres.of_links(finger.links) for finger in HAND.fingers], gel_grid(HAND, [SENSOR] * 4)
    centres, lost = world_centres(spheres, frames[0]), 2.0**-20 * 11  # float32 at 10 m
    clearance, (contact, coverage) = finger_clearance(field, fingers, frames), gel_contact(field, gel_probes(HAND, grid, frames))
    for number, finger in enumerate(HAND.fingers):
        own = np.isin(spheres.link, finger.links)
        assert abs(clearance[0, number] - (centres[own, 2] - base[2] - spheres.radii[own]).min()) <= lost
        probes = (frames[0, HAND.sensors[number].link] @ np.vstack([grid[number].T, np.ones(grid.shape[1])]))[2] - base[2]
        assert abs(contact[0, number] - probes.min()) <= lost
        assert (probes < -lost).mean() <= coverage[0, number] <= (probes < lost).mean()


def test_finger_without_collision_shape_is_rejected(hand: Hand) -> None:
    thumb = hand.fingers[3].links
    links = tuple(replace(link, collisions=()) if number in thumb else link for number, link in enumerate(hand.links))
    bare = replace(hand, links=links)
    with pytest.raises(InvalidInput, match=r"allegro_right\.urdf: no link of thumb has a collision shape"):
        prepare_grasp_ik(bare, collision_spheres(bare, spacing=0.02), [SENSOR] * 4, samples=64, clearance=0.0, finger_gap=0.0)


@pytest.mark.parametrize(("cell", "band"), [(0.005, 0.012), (0.3, 0.4)], ids=["fine", "cells larger than the hand"])
def test_penetration_of_the_palm_in_a_block_is_its_depth(hand: Hand, cell: float, band: float) -> None:
    block = trimesh.creation.box((0.4, 0.4, 0.4) if cell < 0.1 else (4.0, 4.0, 4.0))
    block.apply_translation((0, 0, -block.extents[2] / 2))
    field = build_distance_field(block.vertices, block.faces, cell=cell, band=band)
    palm = collision_spheres(hand, spacing=0.006).of_links([0])
    for height in (-0.003, -0.05, 0.02):
        pose = tangent_palm_pose(hand, np.zeros(3), np.array([0, 0, 1.0]), distance=height, angle=0.3)
        lowest = (palm.centres @ pose[2, :3] + pose[2, 3] - palm.radii).min()
        assert penetration_depth(field, palm, np.tile(pose, (len(hand.links), 1, 1))) == pytest.approx(max(0, -lowest), abs=1e-12)
    assert lowest > 0


def test_penetration_of_thin_parts_is_measured_where_the_grid_is_wrong(rng: np.random.Generator) -> None:
    """The grid places points in a thin plate outside it; their depth is still measured."""
    mistaken = 0
    for _ in range(6):
        body = trimesh.creation.box((9 * CELL, 2 * CELL, 6 * CELL))
        field = build_distance_field(body.vertices @ random_rotation(rng).T, body.faces, cell=CELL, band=BAND)
        points = rng.dirichlet([1] * 8, 1000) @ field.vertices
        exact, seen = field.exact(points), field.lookup(points.T.astype(np.float32))
        worst = int(np.where(exact < 0, seen, -np.inf).argmax())
        sphere = CollisionSpheres(points[[worst]], np.zeros(1), np.zeros(1, np.intp))
        assert penetration_depth(field, sphere, np.eye(4)[None]) == pytest.approx(max(0, -exact[worst]), abs=1e-12)
        mistaken += bool(seen[worst] > CELL / 4)
    assert mistaken > 0


def test_near_gaps_hold_all_gaps_below_the_limit(hand: Hand, rng: np.random.Generator) -> None:
    body = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    field = build_distance_field(body.vertices, body.faces, cell=0.005, band=0.03)
    spheres = collision_spheres(hand, spacing=0.02)
    for limit in (0.0, 0.002):
        frames = forward_kinematics(hand, random_pose(rng, rng.normal(size=3) * 0.1), rng.uniform(hand.lower, hand.upper))
        gaps = field.exact(world_centres(spheres, frames)) - spheres.radii
        measured = near_gaps(field, spheres, frames, limit)
        assert len(measured) < len(gaps)
        np.testing.assert_array_equal(measured[measured < limit], gaps[gaps < limit])
        assert penetration_depth(field, spheres, frames) == max(0.0, -gaps.min())

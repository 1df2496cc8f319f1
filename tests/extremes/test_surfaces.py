"""Gate, placing, sampling and exterior points of meshes of any size, place and shape."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import strategies as st

from pipeline.dataset.mesh_rows import mesh_row, read_mesh
from pipeline.kernels.geometry.exterior_sampling import RAY_OFFSET, EscapeTest, sample_exterior
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products, flatness
from pipeline.kernels.geometry.mesh_cleaning import MIN_FLATNESS, clean_mesh, number_positions
from pipeline.kernels.geometry.normalise import POSITION, normalise_mesh
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from tests.conftest import mesh_of
from tests.extremes.profile import for_all
from tests.extremes.strategies import EPS, aspects, offsets, scales, seeds, sliver, turn

BOX = trimesh.creation.box((0.3, 0.2, 0.4))
BALL = trimesh.creation.icosphere(subdivisions=2)


def exact_vector(triangle: np.ndarray) -> list[Fraction]:
    """Cross product of two edges, in fractions."""
    a, b, c = ([Fraction(float(x)) for x in corner] for corner in triangle)
    u, v = [q - p for p, q in zip(a, b, strict=True)], [q - p for p, q in zip(a, c, strict=True)]
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


@for_all(few=50, many=3000, seed=seeds, scale=scales, offset=offsets, aspect=aspects)
def test_face_vectors_err_by_a_few_units_of_the_edges_product(seed, scale, offset, aspect) -> None:
    triangle = sliver(aspect, np.random.default_rng(seed)) * scale + offset
    error = [Fraction(float(got)) - true for got, true in zip(face_cross_products(triangle[None])[0], exact_vector(triangle), strict=True)]
    edges = np.linalg.norm(triangle[1:] - triangle[0], axis=1)
    assert max(abs(float(e)) for e in error) <= 4 * EPS * edges.prod()


@for_all(few=30, many=1000, seed=seeds, scale=scales, offset=offsets, flat=st.integers(0, 3), twice=st.integers(0, 5))
def test_the_gates_verdict_depends_on_shape_alone(seed, scale, offset, flat, twice) -> None:
    """Size, place, attitude, winding and the order of faces change nothing but, far from the origin, a digit of a vertex."""
    rng = np.random.default_rng(seed)
    vertices = BOX.vertices @ turn(rng).T * scale + offset
    faces = [BOX.faces, *([[k, k, 7 - k]] for k in range(flat)), *(rng.permutation(BOX.faces[k])[None] for k in range(twice))]
    faces = rng.permutation(np.vstack(faces))
    gated, report = clean_mesh(Mesh.bare(vertices, faces), 100)
    assert (report.degenerate_faces, report.duplicate_faces, report.watertight) == (flat, twice, True)
    assert len(gated.faces) == 12


@for_all(few=30, many=1000, seed=seeds, exponent=st.floats(0, 12))
def test_slivers_are_faces_and_what_rounding_makes_of_lines_is_none(seed, exponent) -> None:
    rng = np.random.default_rng(seed)
    thin = sliver(10.0**exponent, rng)
    line = np.array([thin[0], thin[1], (thin[0] + thin[1]) / 2])
    report = clean_mesh(Mesh.bare(np.vstack([thin, line]), [[0, 1, 2], [3, 4, 5]]), 10)[1]
    assert report.degenerate_faces == 1
    assert 10.0**-exponent > MIN_FLATNESS


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_vertices_that_are_no_numbers_are_named(bad) -> None:
    vertices = BOX.vertices.copy()
    vertices[0, 1] = bad
    mesh = Mesh.bare(vertices, BOX.faces)
    with pytest.raises(ValueError, match="1 of 8 vertices are not finite"):
        clean_mesh(mesh, 100)
    with pytest.raises(ValueError, match="some are NaN or infinite"):
        normalise_mesh(mesh, "z", 0.5)
    with pytest.raises(ValueError, match="of 12 triangles have NaN or infinite corners"):
        sample_exterior(mesh, 10, np.random.default_rng(0))


@pytest.mark.parametrize(("vertices", "message"), [(np.zeros((0, 3)), "there are none"), (np.ones((4, 3)), "all 4 vertices are at")])
def test_what_has_no_size_cannot_be_scaled(vertices, message) -> None:
    with pytest.raises(ValueError, match=message):
        normalise_mesh(Mesh.bare(vertices, np.zeros((0, 3))), "z", 0.5)


def test_minus_zero_is_zero() -> None:
    places = number_positions(np.array([[0.0, 1, 2], [-0.0, 1, 2], [0.0, 1, 3]]))
    assert places[0] == places[1] != places[2]


@for_all(few=30, many=1000, scale=scales, offset=offsets, up=st.sampled_from("xyz"))
def test_placing_is_the_same_for_every_size_and_place(scale, offset, up) -> None:
    """As far as the source's own float64 digits reach: a unit in the last place of its offset, scaled as the object is."""
    here, there = (normalise_mesh(Mesh.bare(BALL.vertices * s + o, BALL.faces), up, 0.5).vertices for s, o in ((1, 0), (scale, offset)))
    digits = EPS * (np.abs(offset).max() + scale) / scale
    assert np.abs(there - here).max() <= 4 * digits + 4 * EPS * POSITION.max()


def test_rows_give_back_the_mesh_to_the_bit() -> None:
    mesh = Mesh.bare(BALL.vertices * 1e-3 + 1e3, BALL.faces)
    again = read_mesh(mesh_row(mesh))
    assert again.triangles.tobytes() == mesh.triangles.tobytes()
    assert again.look.textures == ()


@for_all(few=30, many=1000, seed=seeds, scale=scales, offset=offsets, aspect=aspects)
def test_points_lie_on_their_triangle(seed, scale, offset, aspect) -> None:
    rng = np.random.default_rng(seed)
    triangle = sliver(aspect, rng) * scale + offset
    normal = exact_vector(triangle)
    length = float(sum(n * n for n in normal)) ** 0.5
    for point in sample_triangles(triangle[None], 10, rng)[0]:
        above = sum(n * (Fraction(float(p)) - Fraction(float(a))) for n, p, a in zip(normal, point, triangle[0], strict=True))
        beyond = []
        for k in range(3):
            start, end = triangle[k], triangle[(k + 1) % 3]
            doubled = sum(m * n for m, n in zip(exact_vector(np.array([start, end, point])), normal, strict=True))
            beyond.append(-float(doubled) / length / np.linalg.norm(end - start))
        assert max(abs(float(above)) / length, *beyond) <= 8 * EPS * np.abs(triangle).max()


@for_all(few=50, many=3000, seed=seeds, scale=st.floats(-100, 100).map(lambda e: 10.0**e), offset=offsets, aspect=aspects)
def test_flatness_is_one_over_the_aspect_at_any_size_and_place(seed, scale, offset, aspect) -> None:
    triangle = sliver(aspect, np.random.default_rng(seed))
    assert flatness(triangle[None] * scale)[0] == pytest.approx(1 / aspect, rel=1e-6)
    assert flatness(triangle[None] + offset)[0] == pytest.approx(1 / aspect, rel=1e-6, abs=8 * EPS * (np.abs(offset).max() + 1))
    assert flatness(np.array([triangle[[0, 0, 0]], triangle[[0, 1, 1]]])).tolist() == [0, 0]


class Last:
    """The greatest number that a generator draws, again and again."""

    def random(self, size: int | tuple[int, ...]) -> np.ndarray:
        return np.full(size, 1 - 2.0**-53)


@pytest.mark.parametrize("size", [1e-75, 1e-3, 1.0, 3.0, 1e3, 1e75])
def test_faces_without_area_are_never_drawn_not_even_at_the_end(size) -> None:
    real = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]) * size
    flat = np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]]) * size
    triangles = np.concatenate([flat, real, flat, real / 3, flat])
    assert sample_triangles(triangles, 5, Last())[1].tolist() == [3] * 5
    assert set(sample_triangles(triangles, 1000, np.random.default_rng(0))[1].tolist()) == {1, 3}


def test_no_points_of_a_sample_are_asked_of_the_sampler_and_refused_of_a_surface(rng) -> None:
    assert sample_triangles(BOX.vertices[BOX.faces], 0, rng)[0].shape == (0, 3)
    with pytest.raises(ValueError, match="0 points are no sample"):
        sample_exterior(mesh_of(BOX), 0, rng)


@pytest.mark.parametrize("faces", [np.zeros((0, 3)), [[0, 1, 2]]])
def test_a_surface_without_area_is_named(faces, rng) -> None:
    with pytest.raises(ValueError, match="has an area"):
        sample_exterior(Mesh.bare(np.ones((3, 3)), faces), 10, rng)


def test_faces_that_placing_flattened_are_no_trouble(rng) -> None:
    """A face of 1e-18 m is one to the gate, and has no digit left at the object's place."""
    speck = np.array([[0, 0, 0], [0, 0, 1e-18], [1e-18, 0, 0]])
    gated, report = clean_mesh(Mesh.bare(np.vstack([BOX.vertices, speck]), np.vstack([BOX.faces, [8, 9, 10]])), 100)
    assert report.degenerate_faces == 0
    placed = normalise_mesh(gated, "z", 0.5)
    assert (face_cross_products(placed.triangles)[-1] == 0).all()
    points, normals = sample_exterior(placed, 500, rng)
    assert np.isfinite(points).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)


def test_vertices_that_no_face_uses_do_not_move_the_sky(rng) -> None:
    inner = trimesh.creation.box((0.1, 0.1, 0.1))
    both = mesh_of(BOX, inner)
    with_rubbish = Mesh.bare(np.vstack([both.vertices, [[np.nan] * 3, [1e12] * 3]]), both.faces)
    points, _ = sample_exterior(with_rubbish, 1000, rng)
    assert np.abs(points).max(axis=1).min() > 0.09


@for_all(few=6, many=150, seed=seeds, scale=scales, offset=offsets)
def test_exterior_points_of_hidden_geometry_anywhere(seed, scale, offset) -> None:
    """A box in a box, all faces twice, every other one turned over, self-intersecting, of any size at any place."""
    rng = np.random.default_rng(seed)
    parts = [trimesh.creation.box((1, 1, 1)), trimesh.creation.box((0.4, 0.4, 0.4)), trimesh.creation.box((0.2, 0.2, 0.9))]
    whole = trimesh.util.concatenate(parts)
    faces = np.vstack([whole.faces, whole.faces])
    faces[::2] = faces[::2, ::-1]
    points, normals = sample_exterior(Mesh.bare(whole.vertices * scale + offset, faces), 300, rng)
    local = (points - offset) / scale
    digits = EPS * (np.abs(offset).max() + scale) / scale
    assert np.abs(np.abs(local).max(axis=1) - 0.5).max() <= 8 * digits
    assert ((local * normals).sum(axis=1) >= 0.5 - 1e-6 - 8 * digits).all()


@pytest.mark.parametrize("aspect", [1e3, 1e8])
def test_a_solid_of_slivers_is_as_solid_as_another(aspect, rng) -> None:
    """A prism whose top is cut into slivers of that aspect beside ordinary faces."""
    across = np.array([0, 1 / aspect, 0.5, 1])
    lid = np.array([[x, y, 1.0] for y in across for x in (0, 1)])
    box = trimesh.creation.box().apply_translation((0.5, 0.5, 0.5))
    sides = box.faces[box.face_normals[:, 2] < 0.5]
    strips = np.array([[2 * k, 2 * k + 1, 2 * k + 3] for k in range(3)] + [[2 * k, 2 * k + 3, 2 * k + 2] for k in range(3)]) + 8
    mesh = Mesh.bare(np.vstack([box.vertices, lid]), np.vstack([sides, strips]))
    _, normals = sample_exterior(mesh, 2000, rng)
    thin = mesh.triangles[len(sides) :][[0, 3]]
    places = sample_triangles(thin, 200, rng)[0]
    front, back = EscapeTest(mesh).count(places, np.tile([0, 0, 1.0], (200, 1)))
    assert (front > back).all()
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1, atol=1e-9)


@pytest.mark.parametrize("thickness", [2e-5, 1e-4, 1e-2])
def test_walls_as_thin_as_stated_have_an_outside(thickness, rng) -> None:
    """An inside-out plate: only its thickness tells which side is out."""
    plate = trimesh.creation.box((1, 1, thickness * np.sqrt(2)))
    points, normals = sample_exterior(Mesh.bare(plate.vertices, plate.faces[:, ::-1]), 2000, rng)
    assert ((points * normals)[:, 2][np.abs(normals[:, 2]) > 0.5] > 0).all()
    assert thickness > RAY_OFFSET


def test_a_single_triangle_is_seen_from_the_side_it_is_wound_to(rng) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * 1e-3 + 1e3
    for faces, up in (([[0, 1, 2]], 1), ([[2, 1, 0]], -1)):
        _, normals = sample_exterior(Mesh.bare(corners, faces), 50, rng)
        np.testing.assert_allclose(normals, np.tile([0, 0, up], (50, 1)), atol=1e-9)

"""Signed distances, on meshes that have an inside and on those that have none."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.distance import DistanceField, distance_field
from tests.grasps.conftest import mug, placed

CELL = 0.0025


def field_of(mesh: Mesh) -> DistanceField:
    return distance_field(mesh.vertices, mesh.faces, CELL, 0.012)


def around(mesh: Mesh, rng: np.random.Generator, count: int = 20_000) -> np.ndarray:
    return rng.uniform(mesh.vertices.min(axis=0) - 0.01, mesh.vertices.max(axis=0) + 0.01, (count, 3))


def box_distance(points: np.ndarray, half: np.ndarray) -> np.ndarray:
    beyond = np.abs(points - [0, 0, 0.6]) - half
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_box_to_the_last_digit(rng: np.random.Generator, inside_out: bool) -> None:
    mesh = placed(trimesh.creation.box((0.1, 0.16, 0.3)))
    if inside_out:
        mesh = Mesh.bare(mesh.vertices, mesh.faces[:, ::-1])
    points = around(mesh, rng)
    np.testing.assert_allclose(field_of(mesh).exact(points), box_distance(points, np.array([0.05, 0.08, 0.15])), atol=1e-12)


def test_the_grid_is_first_order_in_its_band_and_a_bound_beyond(rng: np.random.Generator) -> None:
    mesh = placed(trimesh.creation.icosphere(subdivisions=4, radius=0.1))
    field, points = field_of(mesh), around(mesh, rng)
    exact = field.exact(points)
    seen = field.lookup(points.T.astype(np.float32))
    near = np.abs(exact) < 0.012
    assert np.abs(seen - exact)[near].max() < CELL / 10
    far = exact > 0.015
    assert (seen[far] <= exact[far] + 1e-6).all()
    assert (seen[far] > 0.01).all()


def test_a_box_in_a_box_is_solid(rng: np.random.Generator) -> None:
    mesh = placed(trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.1, 0.1, 0.1)))
    points = around(mesh, rng)
    outside = np.abs(points - [0, 0, 0.6]).max(axis=1) > 0.1
    assert ((field_of(mesh).exact(points) > 0) == outside).all()


def test_an_open_cup_is_outside_within() -> None:
    field = field_of(mug())
    centre = mug().vertices[:, 0].min() + 0.09  # the cup's axis
    assert field.exact(np.array([[centre, 0.0, 0.6]]))[0] == pytest.approx(0.084, abs=3e-4)  # a polygon of 48 sides


def test_an_open_sheet_has_no_inside(rng: np.random.Generator) -> None:
    mesh = Mesh.bare(np.array([[0, 0, 0.6], [0.2, 0, 0.6], [0, 0.2, 0.6]]), np.array([[0, 1, 2]]))
    points = around(mesh, rng, 2000)
    assert (field_of(mesh).exact(points) >= 0).all()


def test_sides_agree_with_winding_numbers(rng: np.random.Generator) -> None:
    """A closed mesh with parts of all sizes: sides differ at most in what is thinner than two cells."""
    mesh = placed(trimesh.creation.torus(0.15, 0.03), trimesh.creation.cylinder(0.01, 0.3), trimesh.creation.box((0.05, 0.3, 0.02)))
    points = around(mesh, rng)
    signed = field_of(mesh).exact(points)
    winding = igl.fast_winding_number(mesh.vertices, mesh.faces.astype(np.int64), points)
    wrong = (winding > 0.5) != (signed < 0)
    assert wrong.mean() < 1e-3
    assert np.abs(signed[wrong]).max(initial=0) < CELL


def test_a_large_object_gets_larger_cells() -> None:
    mesh = placed(trimesh.creation.box((2.0, 2.0, 2.0)))
    assert field_of(mesh).cell > CELL

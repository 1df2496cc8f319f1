"""Convex shapes of large meshes: face budget, error bound measured independently."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.convex_shapes import MAX_FACES, SHRUNKEN_TOLERANCE, TOLERANCE, convex_error, shrunken_hull, with_convex_shapes
from pipeline.kernels.hand.model import Link, Shape


def link(*meshes: Any) -> Link:
    shapes = [Shape("mesh", (1.0, 1.0, 1.0), np.eye(4), Mesh.bare(mesh.vertices, mesh.faces)) for mesh in meshes]
    return Link("link", (), tuple(shapes))


def bumpy_link(rng: np.random.Generator) -> Any:
    """Make a bumpy link of a finger's size."""
    body = trimesh.creation.icosphere(subdivisions=5)
    body.vertices = body.vertices * [0.012, 0.015, 0.05] * (1 + 2e-4 * rng.standard_normal((len(body.vertices), 1)))
    return body


def distance_outside(points: np.ndarray, mesh: Mesh) -> float:
    """Compute the greatest distance of points from a convex body, by trimesh."""
    body = trimesh.Trimesh(mesh.vertices, mesh.faces).convex_hull
    hull = ConvexHull(mesh.vertices)
    height = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    beyond = points[np.argsort(height)[-500:]]  # a distance is no less than the height above a plane
    beyond = beyond[np.sort(height)[-500:] > 0]
    return float(trimesh.proximity.closest_point_naive(body, beyond)[1].max()) if len(beyond) else 0.0


def test_large_mesh_becomes_a_hull_within_the_budget_and_the_reported_loss(rng: np.random.Generator) -> None:
    body = bumpy_link(rng)
    heavy = link(body)
    (shape,) = with_convex_shapes(heavy).collisions
    assert len(body.faces) == 20_480
    assert len(ConvexHull(body.vertices).simplices) > 2 * MAX_FACES
    assert len(shape.mesh.faces) <= MAX_FACES
    corners = body.vertices[ConvexHull(body.vertices).vertices]
    lost = distance_outside(corners, shape.mesh)
    error = convex_error(heavy, with_convex_shapes(heavy))
    assert (error.faces, error.kept) == (len(body.faces), len(shape.mesh.faces))
    assert error.lost == pytest.approx(lost, abs=1e-9)
    assert 0 < lost <= 4 * TOLERANCE
    assert {tuple(vertex) for vertex in shape.mesh.vertices} <= {tuple(vertex) for vertex in body.vertices}  # so nothing is added


def test_slabs_contain_the_surface_between_their_ends() -> None:
    """An open tube: each slab is a drum, and together they are the tube's hull."""
    tube = trimesh.creation.annulus(r_min=0.01, r_max=0.012, height=0.08)
    slabs = with_convex_shapes(link(tube), 4).collisions
    ends = np.linspace(-0.04, 0.04, 5)
    for (low, high), slab in zip(pairwise(ends), slabs, strict=True):
        assert slab.mesh.vertices[:, 2].min() == pytest.approx(low)
        assert slab.mesh.vertices[:, 2].max() == pytest.approx(high)
        assert trimesh.Trimesh(slab.mesh.vertices, slab.mesh.faces).convex_hull.volume == pytest.approx(tube.convex_hull.volume / 4)


def test_depth_of_filled_hollows_is_measured() -> None:
    """A tray with walls of 20 mm: its hull fills it to the brim; slabs across it do so too, except that bare ends of a bar are none."""
    sides = [((0.1, 0.06, 0.002), (0, 0, 0.001)), ((0.1, 0.002, 0.02), (0, 0.029, 0.01)), ((0.1, 0.002, 0.02), (0, -0.029, 0.01))]
    tray = trimesh.util.concatenate([trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in sides])
    error = convex_error(link(tray), with_convex_shapes(link(tray), 1))
    assert error.lost == pytest.approx(0, abs=1e-12)
    assert error.filled == pytest.approx(0.018, abs=0.001)
    bar = link(trimesh.creation.box((0.1, 0.01, 0.01)))
    assert convex_error(bar, with_convex_shapes(bar, 5)).filled == pytest.approx(0, abs=1e-9)  # where slabs meet, nothing is filled


def test_shrunken_hull_of_a_cube_is_a_smaller_cube_and_of_a_plate_a_thinner_one() -> None:
    for sides, left in (((0.02, 0.03, 0.04), (0.018, 0.028, 0.038)), ((0.05, 0.05, 0.001), (0.0491, 0.0491, 0.0001))):
        box = trimesh.creation.box(sides, trimesh.transformations.translation_matrix((0.1, 0, 0)))
        shrunken = shrunken_hull(Mesh.bare(box.vertices, box.faces), 0.001)
        assert np.ptp(shrunken.vertices, axis=0) == pytest.approx(left, abs=1e-9)
        assert len(shrunken.vertices) == 8


def test_shrunken_hull_of_a_bumpy_link_has_few_corners_and_keeps_its_distance() -> None:
    """A ball of the margin's radius about each of its points stays within the link, and reaches its surface but for the tolerance."""
    body = bumpy_link(np.random.default_rng(0))
    shrunken = shrunken_hull(Mesh.bare(body.vertices, body.faces), 0.001)
    planes = ConvexHull(body.vertices).equations
    assert (shrunken.vertices @ planes[:, :3].T + planes[:, 3]).max() <= -0.001 + 1e-9
    assert distance_outside(body.vertices, shrunken) < 0.001 + SHRUNKEN_TOLERANCE + 2e-4
    assert len(shrunken.vertices) < 400 < len(body.vertices) / 20

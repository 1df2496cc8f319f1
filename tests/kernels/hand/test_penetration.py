"""Penetration of a hand into objects whose depth is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pipeline.kernels.hand.collision_shapes import CollisionSpheres, collision_spheres
from pipeline.kernels.hand.distance_field import build_distance_field
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.palm_pose import tangent_palm_pose
from pipeline.kernels.hand.penetration import penetration_depth
from tests.strategies import random_rotation

CELL, BAND = 0.02, 0.05


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
    """The grid takes points in a thin plate for points beside it; they are measured all the same."""
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

"""Contact, clearance and penetration over planes and blocks, where distances are known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.collision_shapes import CollisionSpheres, collision_spheres
from pipeline.kernels.hand.distance_field import (
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
from tests.kernels.hand.meshes import random_pose
from tests.strategies import random_rotation, seeds

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
    centres, lost = spheres.world_centres(frames[0]), 2.0**-20 * 11  # float32 at 10 m
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
        gaps = field.exact(spheres.world_centres(frames)) - spheres.radii
        measured = near_gaps(field, spheres, frames, limit)
        assert len(measured) < len(gaps)
        np.testing.assert_array_equal(measured[measured < limit], gaps[gaps < limit])
        assert penetration_depth(field, spheres, frames) == max(0.0, -gaps.min())

"""Contact of gels and clearance of fingers over a plane, where distance is height."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.collision_shapes import collision_spheres
from pipeline.kernels.hand.distance_field import build_distance_field
from pipeline.kernels.hand.finger_distances import finger_clearance, finger_geometry, gel_contact, gel_probes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from tests.kernels.hand.meshes import random_pose
from tests.strategies import seeds

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
    fingers, lost = finger_geometry(HAND, spheres, [SENSOR] * 4), 2.0**-20 * 11  # float32 at 10 m
    centres = spheres.world_centres(frames)
    clearance, (contact, coverage) = finger_clearance(field, fingers, frames), gel_contact(field, gel_probes(HAND, fingers, frames))
    for number, finger in enumerate(HAND.fingers):
        own = np.isin(spheres.link, finger.links)
        assert abs(clearance[0, number] - (centres[2, 0, own] - base[2] - spheres.radii[own]).min()) <= lost
        probes = (frames[0, HAND.sensors[number].link] @ np.vstack([fingers.probes[number].T, np.ones(fingers.probes.shape[1])]))[2] - base[
            2
        ]
        assert abs(contact[0, number] - probes.min()) <= lost
        assert (probes < -lost).mean() <= coverage[0, number] <= (probes < lost).mean()


def test_finger_without_collision_shape_is_refused(hand: Hand) -> None:
    thumb = hand.fingers[3].links
    links = tuple(replace(link, collisions=()) if number in thumb else link for number, link in enumerate(hand.links))
    bare = replace(hand, links=links)
    with pytest.raises(InvalidInput, match=r"allegro_right\.urdf: no link of thumb has a collision shape"):
        finger_geometry(bare, collision_spheres(bare, spacing=0.02), [SENSOR] * 4)

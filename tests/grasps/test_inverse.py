"""The search for joint angles, on an object whose answer is known: a plate."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pipeline.kernels.hand.approach import draw_back
from pipeline.kernels.hand.bodies import collision_balls
from pipeline.kernels.hand.clearance import deepest
from pipeline.kernels.hand.inverse import has_room, solve
from pipeline.kernels.hand.kinematics import forward, sensor_poses
from pipeline.kernels.hand.placement import tangent_pose
from pipeline.kernels.hand.reach import gel_contact, gel_probes
from stages.simulate_grasps.rig import Rig, Scene, make_scene
from tests.grasps.conftest import placed


@pytest.fixture(scope="module")
def plate() -> Scene:
    """2 cm thick; its upper side is at z = 0.61."""
    mesh = placed(trimesh.creation.box((0.4, 0.4, 0.02)))
    return make_scene(mesh, mesh.vertices, mesh.vertices, 0.0025)


def above_plate(rig: Rig, height: float) -> np.ndarray:
    return tangent_pose(rig.hand, np.array([0, 0, 0.61]), np.array([0, 0, 1.0]), height, 0.0)


def test_fingers_reach_a_plate_and_stay_out_of_it(rig: Rig, plate: Scene, rng: np.random.Generator) -> None:
    pose = above_plate(rig, 0.05)
    angles = solve(rig.hand, rig.parts, rig.boxes, rig.samples, plate.field, pose, rig.wanted, 3, rng).joint_angles
    assert angles is not None
    assert ((angles >= rig.hand.lower) & (angles <= rig.hand.upper)).all()
    sensors = sensor_poses(rig.hand, pose, angles)
    down = sensors[:, 2, 2]
    assert (down < 0).sum() >= 3  # the gels look at the plate
    frames = forward(rig.hand, pose, angles)
    corners = [frames[link] @ [*ball, 1] for ball, link in zip(rig.dense.centres, rig.dense.link, strict=True)]
    assert np.min(corners, axis=0)[2] > 0.61 - 1e-4  # every rigid point is above the plate: no measure of the search's own


def test_more_rounds_find_no_less(rig: Rig, plate: Scene) -> None:
    pose = above_plate(rig, 0.05)
    coverage = []
    for rounds in (0, 3):
        found = solve(rig.hand, rig.parts, rig.boxes, rig.samples, plate.field, pose, rig.wanted, rounds, np.random.default_rng(0))
        assert found.joint_angles is not None
        probes = gel_probes(rig.hand, rig.parts, forward(rig.hand, pose, found.joint_angles)[None])
        coverage.append(float(gel_contact(plate.field, probes, 0.0)[1].mean()))
    assert coverage[1] > coverage[0]


def test_a_hand_in_the_plate_has_no_room(rig: Rig, plate: Scene) -> None:
    assert has_room(rig.hand, rig.parts, rig.samples, plate.field, above_plate(rig, 0.06), 0.001)
    assert not has_room(rig.hand, rig.parts, rig.samples, plate.field, above_plate(rig, -0.04), 0.001)


def test_depth_in_the_plate(rig: Rig, plate: Scene) -> None:
    """The palm's face set 3 mm into the plate: so deep it stands, by balls as by arithmetic."""
    pose = above_plate(rig, -0.003)
    angles = np.clip(np.full(16, -0.1), rig.hand.lower, rig.hand.upper)
    angles[12] = rig.hand.lower[12]
    frames = forward(rig.hand, pose, angles)
    palm = collision_balls(rig.hand, 0.004).of([0])
    assert deepest(plate.field, palm, frames) == pytest.approx(0.003, abs=1e-4)
    assert deepest(plate.field, palm, forward(rig.hand, above_plate(rig, 0.001), angles)) == 0


def test_drawing_back_moves_sensors_against_their_normals(rig: Rig, rng: np.random.Generator) -> None:
    middle = (rig.hand.lower + rig.hand.upper) / 2
    angles = middle + rng.uniform(-0.2, 0.2, 16)
    before, after = (sensor_poses(rig.hand, np.eye(4), q) for q in (angles, draw_back(rig.hand, angles, [0.002])[0]))
    moved = after[:, :3, 3] - before[:, :3, 3]
    np.testing.assert_allclose(moved, -0.002 * before[:, :3, 2], atol=3e-4)

"""The hold test against Coulomb's law: a post between the pads of a gripper."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp_closure import Contact, contact_from_depth
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.physics.engines import Engine, hold_test
from pipeline.physics.gel_plates import GEL_MODULUS
from pipeline.physics.simulation import GRAVITY
from tests.kernels.hand.meshes import centred, points_on

GRIPPER, SENSOR = load_hand("two_finger_gripper"), load_sensor("gel_16mm")
WIDTH, PRESSED = 0.03, 0.002
HOLDS = 2 * GRIPPER.friction * GEL_MODULUS * SENSOR.width**2 * PRESSED / SENSOR.w / -GRAVITY
"""kg that friction of the two pads holds: 0.8."""


def post(subdivisions: int = 0) -> Mesh:
    body = trimesh.creation.box((WIDTH, WIDTH, 0.2))
    for _ in range(subdivisions):
        body = body.subdivide()
    return centred(body)


def lifted(mesh: Mesh, *, mass: float, sideways: float = 0.0, engine: Engine = "pybullet") -> bool:
    """Grip a post from its side, the gels pressed in by 2 mm; with the gripper moved sideways only the right finger touches."""
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # the palm faces +x, the fingers slide along y
    pose[:3, 3] = [-0.082, sideways, 0.6]
    angles = np.array([WIDTH / 2 + SENSOR.w - PRESSED + sideways])
    contacts: list[Contact | None] = []
    for sensor_pose in sensor_poses(GRIPPER, pose, angles):
        contacts.append(contact_from_depth(ray_depth(box_faces(mesh.triangles), sensor_pose, SENSOR), sensor_pose, SENSOR))
    with hold_test(engine, GRIPPER, [SENSOR, SENSOR], mass=mass) as test:
        test.load(mesh, points_on(mesh, 2000, seed=0)[0])
        return test.hold(pose, angles, contacts).moved <= 0.05


@pytest.mark.parametrize("engine", get_args(Engine))
@pytest.mark.parametrize(("share", "holds"), [(0.8, True), (1.25, False)])
def test_opposed_gels_hold_what_their_friction_can(engine: Engine, share: float, holds: bool) -> None:
    assert lifted(post(), mass=share * HOLDS, engine=engine) == holds


@pytest.mark.parametrize("engine", get_args(Engine))
def test_object_that_is_touched_from_one_side_falls(engine: Engine) -> None:
    assert not lifted(post(), mass=0.05, sideways=0.03, engine=engine)


def test_mesh_of_several_shapes_is_one_body() -> None:
    """49,152 faces: more than one shape of PyBullet takes."""
    fine = post(subdivisions=6)
    assert lifted(fine, mass=0.5 * HOLDS)
    assert not lifted(fine, mass=0.5 * HOLDS, sideways=0.03)

"""Coulomb's law in both engines: what two opposed pads hold, to 5 %."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp_closure import Contact
from pipeline.kernels.hand.model import Hand
from pipeline.physics.engines import Engine, hold_test
from pipeline.physics.gel_plates import GEL_MODULUS
from pipeline.physics.simulation import GRAVITY
from tests.kernels.hand.meshes import centred, points_on

ENGINES = get_args(Engine)
SENSOR = load_sensor("gel_16mm")
RADIUS, PRESSED, FORCE = 0.02, 0.002, 4.0
"""m, half the width of what is pinched and how deep it is in each gel; N of each pad."""
MASS = 0.3
LIMIT = -MASS * GRAVITY / (2 * FORCE)
"""The friction that just holds it: 0.37."""

PINCERS = """<robot name="pincers"><link name="palm"/>
<link name="left"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="right"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="left" type="prismatic"><parent link="palm"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.1" effort="50" velocity="1"/></joint>
<joint name="right" type="prismatic"><parent link="palm"/><child link="right"/><axis xyz="0 -1 0"/>
<limit lower="0" upper="0.1" effort="50" velocity="1"/></joint></robot>"""
HAND = """{name: pincers, urdf: pincers.urdf, sensor: gel_16mm, torque: 50, palm: {link: palm, facing: [0, 0, 1], centre: [0, 0, 0]},
fingers: [
{name: left, joints: [left], sensor: {link: left, origin: [0, 0, 0.1], normal: [0, -1, 0], columns: [1, 0, 0]}},
{name: right, joints: [right], sensor: {link: right, origin: [0, 0, 0.1], normal: [0, 1, 0], columns: [1, 0, 0]}}]}"""


@pytest.fixture(scope="module")
def pincers(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    """Two fingers without shape, whose gels face each other 0.1 m above the palm."""
    folder: Path = tmp_path_factory.mktemp("pincers")
    (folder / "pincers.urdf").write_text(PINCERS)
    (folder / "pincers.yaml").write_text(HAND)
    return load_hand(folder / "pincers.yaml")


def slips(engine: Engine, hand: Hand, mesh: Mesh, *, friction: float, down: tuple[float, float, float] = (0.0, 0.0, -1.0)) -> bool:
    pose = np.eye(4)
    pose[:3, 3] = mesh.vertices.mean(axis=0) - [0, 0, 0.1]
    nearest = SENSOR.w - PRESSED
    contact = Contact(np.zeros(3), np.zeros(3), area=5e-5, volume=FORCE * SENSOR.w / GEL_MODULUS, nearest=nearest)
    with hold_test(engine, hand, [SENSOR, SENSOR], mass=MASS, friction=friction) as test:
        test.load(mesh, points_on(mesh, 2000, seed=0)[0])
        acceleration = -GRAVITY * np.array(down) / np.linalg.norm(down)
        motion = test.hold(pose, np.full(2, RADIUS + nearest), [contact, contact], acceleration=acceleration.tolist(), limit=0.01)
    return motion.moved > 0.01


@pytest.mark.parametrize("engine", ENGINES)
def test_sphere_between_two_fingers_slips_when_friction_says_so(engine: Engine, pincers: Hand) -> None:
    sphere = centred(trimesh.creation.icosphere(subdivisions=4, radius=RADIUS))
    assert not slips(engine, pincers, sphere, friction=1.05 * LIMIT)
    assert slips(engine, pincers, sphere, friction=0.95 * LIMIT)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("down", [(1.0, 0.0, 0.0), (1.0, 0.0, -1.0), (-0.5, 0.0, -1.0)])
def test_friction_is_the_same_in_every_direction_of_the_pads(engine: Engine, pincers: Hand, down: tuple[float, float, float]) -> None:
    plate = centred(trimesh.creation.box((0.1, 2 * RADIUS, 0.1)))
    assert not slips(engine, pincers, plate, friction=1.05 * LIMIT, down=down)
    assert slips(engine, pincers, plate, friction=0.95 * LIMIT, down=down)

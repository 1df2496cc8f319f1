"""A hand of two fingers without shape, whose gels face each other 0.1 m above the palm, and what it pinches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp import Contact, Grasp
from pipeline.kernels.hand.model import Hand
from pipeline.physics.hold_test import GEL_MODULUS, GRAVITY, HoldTest
from tests.kernels.hand.meshes import centred, points_on

SENSOR = load_sensor("gel_16mm")
RADIUS, PRESSED = 0.02, 0.002
"""m, half the width of what is pinched, and how deep it is in each gel."""
ANGLES = np.full(2, RADIUS + SENSOR.w - PRESSED)
"""m, of the two joints in this grasp."""
FORCE, MASS = 4.0, 0.3
"""N of each pad, and kg."""
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


def load_pincers(folder: Path) -> Hand:
    (folder / "pincers.urdf").write_text(PINCERS)
    (folder / "pincers.yaml").write_text(HAND)
    return load_hand(folder / "pincers.yaml")


def pinch(mesh: Mesh, force: float, *, wider: float = 0.0, squeeze: float = 0.0) -> Grasp:
    """Pinch the middle of an object with this force of each gel, N, from fingers that are this much wider, m."""
    pose = np.eye(4)
    pose[:3, 3] = mesh.vertices.mean(axis=0) - [0, 0, 0.1]
    volume = force * SENSOR.w / GEL_MODULUS
    contact = Contact(np.zeros(3), np.zeros(3), area=5e-5, volume=volume, nearest=SENSOR.w - PRESSED)
    return Grasp(pose, ANGLES + wider, ANGLES, ANGLES - squeeze, np.empty((0, 4, 4)), [contact] * 2)


def slips(engine: type[HoldTest], hand: Hand, mesh: Mesh, *, friction: float, down: tuple[float, float, float] = (0.0, 0.0, -1.0)) -> bool:
    acceleration = -GRAVITY * np.array(down) / np.linalg.norm(down)
    with engine(replace(hand, friction=friction), [SENSOR, SENSOR], mass=MASS) as test:
        test.load(mesh, points_on(mesh, 2000, seed=0)[0])
        return test.hold(pinch(mesh, FORCE), acceleration=acceleration.tolist(), limit=0.01).moved > 0.01


def check_friction_limit(engine: type[HoldTest], hand: Hand) -> None:
    """Check Coulomb's law to 5 %: of a sphere, and in several directions along a plate."""
    sphere = centred(trimesh.creation.icosphere(subdivisions=4, radius=RADIUS))
    plate = centred(trimesh.creation.box((0.1, 2 * RADIUS, 0.1)))
    for mesh, down in ((sphere, (0.0, 0.0, -1.0)), *((plate, way) for way in ((1.0, 0.0, 0.0), (1.0, 0.0, -1.0), (-0.5, 0.0, -1.0)))):
        assert not slips(engine, hand, mesh, friction=1.05 * LIMIT, down=down)
        assert slips(engine, hand, mesh, friction=0.95 * LIMIT, down=down)

"""A hand of two fingers without shape, whose gels face each other 0.1 m above the palm, and what it pinches."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp_closure import Contact
from pipeline.kernels.hand.model import Hand
from pipeline.physics.gel_plates import GEL_MODULUS

SENSOR = load_sensor("gel_16mm")
RADIUS, PRESSED = 0.02, 0.002
"""m, half the width of what is pinched, and how deep it is in each gel."""
ANGLES = np.full(2, RADIUS + SENSOR.w - PRESSED)
"""m, of the two joints in this grasp."""

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


def pinching_pose(mesh: Mesh) -> NDArray[np.float64]:
    """Location the hand (4, 4) so that the gels face the middle of an object."""
    pose = np.eye(4)
    pose[:3, 3] = mesh.vertices.mean(axis=0) - [0, 0, 0.1]
    return pose


def pinching_contacts(force: float) -> list[Contact | None]:
    """Describe contacts in which each gel presses with this force, N."""
    volume = force * SENSOR.w / GEL_MODULUS
    return [Contact(np.zeros(3), np.zeros(3), area=5e-5, volume=volume, nearest=SENSOR.w - PRESSED)] * 2

"""The inertia that engines give a link: that of the URDF, about the joint's axis, against the parallel-axis theorem."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.model import Hand
from pipeline.physics.simulation import Simulation
from tests.kernels.hand.meshes import bar

MASS, CENTRE, TURN = 0.03, np.array([0.004, -0.006, 0.03]), np.array([0.3, -0.5, 0.9])
"""Of a finger, kg, m and rad: its centre of mass, and how the frame of its <inertia> is turned."""
TENSOR = np.array([[8e-6, 1e-6, -2e-6], [1e-6, 7e-6, 5e-7], [-2e-6, 5e-7, 5e-6]])
AXIS = np.array([0.6, 0.0, 0.8])
GEL = np.array([0.0, -0.005, 0.05])
"""m, the origin of its sensor."""
FINGER = f"""<robot name="one"><link name="palm"/><link name="finger">
<inertial><origin xyz="{" ".join(map(str, CENTRE))}" rpy="{" ".join(map(str, TURN))}"/><mass value="{MASS}"/>
<inertia {" ".join(f'i{"xyz"[row]}{"xyz"[col]}="{TENSOR[row, col]}"' for row in range(3) for col in range(row, 3))}/></inertial>
<collision><origin xyz="0 0 0.03"/><geometry><box size="0.01 0.01 0.06"/></geometry></collision></link>
<joint name="bend" type="revolute"><parent link="palm"/><child link="finger"/><axis xyz="{" ".join(map(str, AXIS))}"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
HAND = f"""{{name: one, urdf: one.urdf, sensor: gel_16mm, torque: 1, palm: {{link: palm, facing: [0, -1, 0], centre: [0, 0, 0]}},
fingers: [{{name: only, joints: [bend], sensor: {{link: finger, origin: {GEL.tolist()}, normal: [0, -1, 0], columns: [1, 0, 0]}}}}]}}"""


def load_finger(folder: Path) -> Hand:
    (folder / "one.urdf").write_text(FINGER)
    (folder / "one.yaml").write_text(HAND)
    return load_hand(folder / "one.yaml")


def about_axis(tensor: NDArray[np.float64], mass: float, centre: NDArray[np.float64]) -> float:
    return float(AXIS @ tensor @ AXIS + mass * (np.cross(AXIS, centre) ** 2).sum())


def expected() -> float:
    turn = Rotation.from_euler("xyz", TURN).as_matrix()
    return about_axis(turn @ TENSOR @ turn.T, MASS, CENTRE)


def test_pybullet_takes_the_inertia_of_the_urdf(tmp_path: Path) -> None:
    with Simulation(load_finger(tmp_path)) as physics:
        physics.load(bar())
        matrix = physics.client.calculateMassMatrix(physics._body.body, [0.2])
    assert matrix[0][0] == pytest.approx(expected(), rel=1e-4)

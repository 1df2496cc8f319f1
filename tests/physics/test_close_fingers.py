"""Fingers that are built side by side, nearer than the margins of a physics engine and of a search."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import close_links
from pipeline.physics import simulation
from pipeline.physics.simulation import Simulation
from stages.simulate_grasps.prepare import FINGER_GAP, finger_gap
from tests.kernels.hand.meshes import centred

GAP = 0.0008
FINGER = """<link name="{0}"><inertial><origin xyz="0 0 0.03"/><mass value="0.01"/>
<inertia ixx="3e-6" iyy="3e-6" izz="3e-7" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="finger.obj"/></geometry></collision></link>
<joint name="{0}" type="revolute"><parent link="palm"/><child link="{0}"/><origin xyz="{1} 0 0" rpy="0 {2} 0"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1.5" effort="1" velocity="1"/></joint>"""
HAND = """{name: pair, urdf: pair.urdf, sensor: gel_16mm, torque: 1, palm: {link: palm, facing: [0, -1, 0], centre: [0, 0, 0]},
fingers: [
{name: left, joints: [left], sensor: {link: left, origin: [0, -0.005, 0.05], normal: [0, -1, 0], columns: [1, 0, 0]}},
{name: right, joints: [right], sensor: {link: right, origin: [0, -0.005, 0.05], normal: [0, -1, 0], columns: [1, 0, 0]}}]}"""


def load_pair(folder: Path, gap: float) -> Hand:
    """Load two fingers, 1 cm wide, whose sides are `gap` m apart and which lean towards each other by 0.1 degrees."""
    trimesh.creation.box((0.01, 0.01, 0.06), trimesh.transformations.translation_matrix([0, 0, 0.03])).export(folder / "finger.obj")
    fingers = "".join(FINGER.format(name, way * (0.005 + gap / 2), -way * 0.0017) for name, way in (("left", -1), ("right", 1)))
    (folder / "pair.urdf").write_text(f'<robot name="pair"><link name="palm"/>{fingers}</robot>')
    (folder / "pair.yaml").write_text(HAND)
    return load_hand(folder / "pair.yaml")


def settled(hand: Hand) -> np.ndarray:
    target = np.array([0.3, 0.31])
    with Simulation(hand) as physics:
        physics.load(centred(trimesh.creation.box((0.01, 0.01, 0.01))))
        angles, _ = physics.settle(np.eye(4), target - 0.2, target, max_steps=400, resting_speed=2e-3)
    return np.abs(angles - target)


def test_fingers_side_by_side_are_not_pushed_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hand = load_pair(tmp_path, GAP)
    assert settled(hand).max() < 2e-3
    monkeypatch.setattr(simulation, "HULL_MARGIN", 0.0)
    simulation._untested_pairs.cache_clear()
    assert settled(hand).max() > 2e-3  # as without the rule
    simulation._untested_pairs.cache_clear()


def test_finger_gap_is_at_most_half_of_the_gap_at_rest(tmp_path: Path, hand: Hand) -> None:
    near = load_pair(tmp_path, GAP)
    gaps = close_links(near, collision_boxes(near), 2 * FINGER_GAP)
    assert list(gaps) == [(1, 2)]
    assert 0 < gaps[1, 2] < GAP
    assert finger_gap(near) == gaps[1, 2] / 2
    assert finger_gap(hand) == FINGER_GAP

"""MuJoCo against the closed forms that PyBullet meets, with a real hand, and the tests of grasps in both engines."""

import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import trimesh

from benchmarks.grasp_tests import GRASP_TESTS, Engine
from benchmarks.mujoco_hold_test import MujocoHoldTest
from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.physics.hand_mjcf import ARMATURE
from pipeline.physics.hand_urdf import GEL_MASS, gel_name
from tests.kernels.hand.meshes import bar, centred, points_on
from tests.physics.pincers import RADIUS, SENSOR, check_friction_limit, load_pincers, pinch
from tests.physics.test_hold_test import check_gripped_weights, check_untouched_object
from tests.physics.test_inertia import GEL, about_axis, expected, load_finger

PLATE = centred(trimesh.creation.box((0.1, 2 * RADIUS, 0.1)))


@pytest.fixture(scope="module")
def pincers(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return load_pincers(tmp_path_factory.mktemp("pincers"))


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # of convex parts


def test_mujoco_meets_the_closed_forms(pincers: Hand) -> None:
    check_friction_limit(MujocoHoldTest, pincers)
    check_gripped_weights(MujocoHoldTest)
    check_untouched_object(MujocoHoldTest, lambda test: [float(test.data.joint(gel_name(number)).qpos[0]) for number in range(2)])


def test_mujoco_takes_the_inertia_of_the_urdf(tmp_path: Path) -> None:
    with MujocoHoldTest(load_finger(tmp_path), [SENSOR], mass=0.1) as test:
        test.load(bar(), points_on(bar(), 100, seed=0)[0])
        mujoco, model, data = test.mujoco, test.model, test.data
        mujoco.mj_forward(model, data)
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
    joint = model.joint("bend").dofadr[0]
    gel = about_axis(1e-6 * np.eye(3), GEL_MASS, GEL)
    assert matrix[joint, joint] == pytest.approx(expected() + gel + ARMATURE["revolute"], rel=1e-6)


def test_hand_without_contact_keeps_its_posture() -> None:
    """A palm that does not move must not collide with the fingers' first links, which it carries."""
    hand, far, pose = load_hand("allegro_right"), centred(trimesh.creation.box((0.05, 0.05, 0.05))), np.eye(4)
    pose[0, 3] = 1.0
    angles = (hand.lower + hand.upper) / 2
    with MujocoHoldTest(hand, load_worn_sensors(sensor_names(hand, None)), mass=0.2) as test:
        test.load(far, points_on(far, 500, seed=0)[0])
        grasp = Grasp(pose, angles, angles, angles, np.empty((0, 4, 4)), [None] * len(hand.sensors))
        motion = test.hold(grasp, acceleration=(0.0, 0.0, 0.0), seconds=0.2)
        np.testing.assert_allclose([test.data.joint(name).qpos[0] for name in hand.joint_names], angles, atol=1e-3)
    assert motion.moved < 1e-6
    assert motion.penetration == 0


def holds(engine: Engine, name: str, hand: Hand, *, force: float, wider: float = 0.005) -> bool:
    with GRASP_TESTS[name].open(engine, hand, [SENSOR, SENSOR]) as test:
        test.load(PLATE, points_on(PLATE, 2000, seed=0)[0])
        return GRASP_TESTS[name].holds(test, pinch(PLATE, force, wider=wider, squeeze=5e-4))


@pytest.mark.parametrize("engine", get_args(Engine))
@pytest.mark.parametrize("name", GRASP_TESTS)
def test_pinch_holds_if_friction_carries_the_force(engine: Engine, name: str, pincers: Hand) -> None:
    test = GRASP_TESTS[name]
    needed = test.mass * np.linalg.norm(test.accelerations[0]) / (2 * (test.friction or pincers.friction))
    assert holds(engine, name, pincers, force=2.5 * needed)
    assert not holds(engine, name, pincers, force=0.4 * needed)


def test_start_inside_the_object_is_refused(pincers: Hand) -> None:
    """MuJoCo's convex parts are solid; in PyBullet's surface a gel that is all inside meets nothing."""
    assert not holds("mujoco", "dexgraspbench", pincers, force=4.0, wider=-0.015)


def test_missing_package_is_reported_with_its_extra(monkeypatch: pytest.MonkeyPatch, pincers: Hand) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InvalidInput, match=r"pip install .*'\.\[mujoco\]'"):
        MujocoHoldTest(pincers, [SENSOR] * 2, mass=0.1)


MJCF = """
<mujoco><worldbody><body name="arm"><freejoint/><geom size="0.1"/><body name="palm" pos="1 0 0"><joint name="wrist" range="-9 9"/>
  <geom type="box" size="0.02 0.05 0.01"/>
  <body name="left" pos="0 0.04 0"><joint name="left-slide" type="slide" axis="0 -1 0" range="0 0.02"/>
    <geom type="box" size="0.01 0.002 0.04" pos="0 0 0.06"/></body>
  <body name="right" pos="0 -0.04 0"><joint name="right-slide" type="slide" axis="0 1 0" range="0 0.02"/>
    <joint name="turn" axis="1 0 0" range="-20 20"/><geom type="box" size="0.01 0.002 0.04" pos="0 0 0.06"/></body>
</body></body></worldbody>
<tendon><fixed name="pull"><joint joint="left-slide" coef="1"/><joint joint="right-slide" coef="1"/></fixed></tendon>
<actuator><position tendon="pull" kp="10"/></actuator></mujoco>
"""
FINGERS = """{name: pads, model: pads.xml, sensor: gel_16mm, torque: 5, palm: {link: palm, facing: [0, 0, 1], centre: [0, 0, 0.01]},
  frozen: {turn: 0.1}, fingers: [{name: both, joints: [left-slide], sensors: [
    {name: l, link: left, origin: [0, -0.002, 0.08], normal: [0, -1, 0], columns: [1, 0, 0]},
    {name: r, link: right, origin: [0, 0.002, 0.08], normal: [0, 1, 0], columns: [1, 0, 0]}]}]}"""


def test_mujoco_loads_an_mjcf_hand_itself_without_the_arm_that_holds_it(tmp_path: Path) -> None:
    (tmp_path / "pads.xml").write_text(MJCF)
    (tmp_path / "hand.yaml").write_text(FINGERS)
    hand, far, pose, angles = (
        load_hand(tmp_path / "hand.yaml"),
        centred(trimesh.creation.box((0.05, 0.05, 0.05))),
        np.eye(4),
        np.array([0.015]),
    )
    pose[0, 3] = 1.0
    sensors = load_worn_sensors(sensor_names(hand, None))
    with MujocoHoldTest(hand, sensors, mass=0.2) as test:
        test.load(far, points_on(far, 500, seed=0)[0])
        grasp = Grasp(pose, angles, angles, angles, np.empty((0, 4, 4)), [None, None])
        test.hold(grasp, acceleration=(0.0, 0.0, 0.0), seconds=0.1)
        joints = {test.model.joint(joint).name: float(test.data.joint(joint).qpos[0]) for joint in range(test.model.njnt - 1)}
        assert joints.keys() == {"left-slide", "right-slide", "turn", gel_name(0), gel_name(1)}
        assert joints["left-slide"] == pytest.approx(0.015, abs=1e-4)
        assert joints["right-slide"] == pytest.approx(0.015, abs=1e-4)
        assert joints["turn"] == pytest.approx(0.1, abs=1e-2)
        assert test.model.geom_contype.all()
        expected_poses = sensor_poses(hand, pose, angles)
        for number in range(2):
            plate = test.data.body(gel_name(number))
            np.testing.assert_allclose(plate.xpos, expected_poses[number, :3, 3], atol=2e-3)
            np.testing.assert_allclose(plate.xmat.reshape(3, 3), expected_poses[number, :3, :3], atol=1e-2)

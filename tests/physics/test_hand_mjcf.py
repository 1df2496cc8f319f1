"""Hands as MJCF: what MuJoCo reads back."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.physics.hand_mjcf import write_hand_mjcf
from pipeline.physics.hand_urdf import gel_name

mujoco = pytest.importorskip("mujoco")


@pytest.mark.parametrize("name", ["allegro_right", "two_finger_gripper"])
def test_links_and_gels_are_where_our_kinematics_put_them(name: str, tmp_path: Path) -> None:
    hand = load_hand(name)
    sensors = load_worn_sensors(sensor_names(hand))
    joint_names = write_hand_mjcf(hand, sensors, tmp_path / "hand" / "hand.xml")
    assert [path.name for path in (tmp_path / "hand").iterdir()] == ["hand.xml"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "hand" / "hand.xml"))
    data = mujoco.MjData(model)
    assert [model.actuator(number).name for number in range(model.nu)] == list(hand.joint_names)
    assert len(joint_names) == model.nq == len(hand.joint_names) + len(hand.followers)
    rng = np.random.default_rng(0)
    for _ in range(20):
        posture = rng.uniform(hand.lower, hand.upper)
        data.qpos[:] = [*map(hand.joint_values(posture).get, joint_names)]
        mujoco.mj_kinematics(model, data)
        poses = forward_kinematics(hand, np.eye(4), posture)
        for number, link in enumerate(hand.links):
            np.testing.assert_allclose(data.body(link.name).xpos, poses[number, :3, 3], atol=1e-6)
            np.testing.assert_allclose(data.body(link.name).xmat.reshape(3, 3), poses[number, :3, :3], atol=1e-5)  # six digits are written
        for number, (mount, sensor) in enumerate(zip(hand.sensors, sensors, strict=True)):
            expected = poses[mount.link] @ mount.pose @ [0, 0, gel_top(sensor), 1]
            np.testing.assert_allclose(data.body(gel_name(number)).xpos, expected[:3], atol=1e-6)


def test_following_joint_has_an_entry_of_qpos_and_a_gear(tmp_path: Path) -> None:
    gripper = load_hand("two_finger_gripper")
    assert gripper.joint_values(np.array([0.03])) == pytest.approx({"right_slide": 0.03, "left_slide": 0.03})
    write_hand_mjcf(gripper, (), tmp_path / "hand.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml"))
    assert (model.nu, model.neq) == (1, 1)
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.05
    mujoco.mj_step(model, data, nstep=1000)
    np.testing.assert_allclose(data.qpos, 0.05, atol=1e-3)


def test_motors_have_no_attribute_that_older_versions_refuse(tmp_path: Path) -> None:
    write_hand_mjcf(load_hand("two_finger_gripper"), (), tmp_path / "hand.xml")
    (motor,) = [line for line in (tmp_path / "hand.xml").read_text().splitlines() if "<general" in line]
    assert "input=" not in motor
    assert 'gainprm="1000"' in motor

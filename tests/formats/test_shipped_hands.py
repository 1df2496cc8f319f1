"""Shipped hands besides the right Allegro: its mirror image, and a gripper whose fingers share a motor."""

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.physics.simulation import Simulation
from tests.kernels.hand.meshes import centred

FAR = np.eye(4)
FAR[:3, 3] = [1, 1, 1]


def test_left_hand_mirrors_the_right_hand(rng: np.random.Generator) -> None:
    right, left = load_hand("allegro_right"), load_hand("allegro_left")
    for angles in rng.uniform(right.lower, right.upper, (5, len(right.lower))):
        links = [forward_kinematics(hand, np.eye(4), angles) for hand in (right, left)]
        mirror = np.diag([1.0, -1, 1, 1])
        np.testing.assert_allclose(links[1], mirror @ links[0] @ mirror, atol=1e-12)
        sensors = [sensor_poses(hand, np.eye(4), angles) for hand in (right, left)]
        np.testing.assert_allclose(sensors[1][:, :3, 3], sensors[0][:, :3, 3] * [1, -1, 1], atol=1e-12)


def test_gripper_is_one_finger_with_two_sensors() -> None:
    hand = load_hand("two_finger_gripper")
    (finger,) = hand.fingers
    assert (finger.name, finger.joints, finger.sensors) == ("left+right", (0,), (0, 1))
    assert [mount.name for mount in hand.sensors] == ["left", "right"]
    left, right = sensor_poses(hand, np.eye(4), np.array([0.02]))[:, :3, 3]
    np.testing.assert_allclose([left, right], [[0, 0.02, 0.082], [0, -0.02, 0.082]], atol=1e-12)


@pytest.mark.parametrize("blocked", [False, True])
def test_follower_stays_with_its_leader_in_physics(blocked: bool) -> None:
    """Test free fingers and a block that stops only the right finger: the motor of the left one cannot push on."""
    hand = load_hand("two_finger_gripper")
    block = centred(trimesh.creation.box((0.02, 0.02, 0.02)))
    with Simulation(hand) as physics:
        physics.load(block)
        pose = FAR if not blocked else np.eye(4)
        if blocked:
            pose[:3, 3] = [0, 0.04, 0.6 - 0.08]  # the block's far side is 3 cm on the right finger's side of the middle
        start, target = np.array([0.06]), np.array([0.01])
        angles, rests = physics.settle(pose, start, target, max_steps=800, resting_speed=2e-3)
        states = [physics.client.getJointState(physics._body.body, joint)[0] for joint in range(2)]
    assert rests
    assert states[1] == pytest.approx(angles[0], abs=1e-3)
    if blocked:
        assert 0.04 < angles[0] < 0.052
    else:
        assert angles[0] == pytest.approx(0.01, abs=1e-3)

"""Forward kinematics against the hand's documentation, PyBullet, and rigid motion."""

from __future__ import annotations

import numpy as np
import pybullet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.hand.model import Hand
from tests.kernels.hand.meshes import random_pose
from tests.references.allegro_tips import tip_frame
from tests.strategies import EPS, seeds

FLOAT32 = 2e-6  # PyBullet keeps poses in float32: 0.5e-6 was seen
HAND = load_hand("allegro_right")


def angles_of(hand: Hand, rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.uniform(hand.lower, hand.upper, (*shape, len(hand.joint_names)))


def test_forward_kinematics_tips_match_documentation_table(hand: Hand, rng: np.random.Generator) -> None:
    for _ in range(20):
        pose, angles = random_pose(rng), angles_of(hand, rng)
        frames = forward_kinematics(hand, pose, angles)
        for mount in hand.sensors:
            np.testing.assert_allclose(frames[mount.link], pose @ tip_frame(mount.name, angles), atol=1e-12)


def test_forward_kinematics_links_match_pybullet(hand: Hand, rng: np.random.Generator) -> None:
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(hand.urdf), useFixedBase=True, physicsClientId=client)
        infos = [pybullet.getJointInfo(body, joint, physicsClientId=client) for joint in range(len(hand.joints))]
        joints = {info[1].decode(): info[0] for info in infos}
        links = {info[12].decode(): info[0] for info in infos}
        inertial = pybullet.getDynamicsInfo(body, -1, physicsClientId=client)[3]
        pybullet.resetBasePositionAndOrientation(body, inertial, [0, 0, 0, 1], physicsClientId=client)
        for _ in range(5):
            angles = angles_of(hand, rng)
            for name, angle in zip(hand.joint_names, angles, strict=True):
                pybullet.resetJointState(body, joints[name], angle, physicsClientId=client)
            for frame, link in zip(forward_kinematics(hand, np.eye(4), angles)[1:], hand.links[1:], strict=True):
                state = pybullet.getLinkState(body, links[link.name], computeForwardKinematics=True, physicsClientId=client)
                np.testing.assert_allclose(frame[:3, 3], state[4], atol=FLOAT32)
                turn = np.reshape(pybullet.getMatrixFromQuaternion(state[5]), (3, 3))
                np.testing.assert_allclose(frame[:3, :3], turn, atol=FLOAT32)
        assert len(links) + 1 == len(hand.links)
        for info in infos:
            if info[1].decode() in hand.joint_names:
                number = hand.joint_names.index(info[1].decode())
                assert (info[8], info[9]) == (hand.lower[number], hand.upper[number])
    finally:
        pybullet.disconnect(client)


def test_forward_kinematics_broadcasts_poses_against_angles(hand: Hand, rng: np.random.Generator) -> None:
    poses, angles = np.stack([random_pose(rng) for _ in range(3)]), angles_of(hand, rng, 2, 3)
    frames = forward_kinematics(hand, poses, angles)
    assert frames.shape == (2, 3, len(hand.links), 4, 4)
    np.testing.assert_array_equal(frames[1, 2], forward_kinematics(hand, poses[2], angles[1, 2]))
    assert forward_kinematics(hand, np.eye(4), np.zeros((0, 16))).shape == (0, len(hand.links), 4, 4)


@given(seed=seeds, turns=st.integers(-10, 10))
def test_forward_kinematics_frames_are_rigid_and_repeat_with_full_turns(seed, turns) -> None:
    rng = np.random.default_rng(seed)
    pose, angles = random_pose(rng), angles_of(HAND, rng)
    frames, turned = forward_kinematics(HAND, pose, angles), forward_kinematics(HAND, pose, angles + 2 * np.pi * turns)
    rotations = frames[:, :3, :3]
    assert np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max() <= 1e-14
    assert (frames[:, 3] == [0, 0, 0, 1]).all()
    assert np.abs(turned - frames).max() <= 1e-13 + 2 * np.pi * abs(turns) * EPS * 8  # rounding of the angles, four in a row


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_forward_kinematics_rejects_values_that_are_not_finite(hand: Hand, bad: float) -> None:
    angles = np.zeros(16)
    angles[3] = bad
    for ask in (lambda: forward_kinematics(hand, np.eye(4), angles), lambda: sensor_poses(hand, np.eye(4) + bad, np.zeros(16))):
        with pytest.raises(ValueError, match="joint_angles or hand_pose of allegro_right hold NaN or infinity"):
            ask()


def test_forward_kinematics_rejects_wrong_shapes(hand: Hand) -> None:
    with pytest.raises(ValueError, match=r"joint_angles have shape \(15,\); the last dimension must be 16"):
        forward_kinematics(hand, np.eye(4), np.zeros(15))
    with pytest.raises(ValueError, match=r"hand_pose has shape \(3, 4\)"):
        forward_kinematics(hand, np.eye(4)[:3], np.zeros(16))


def test_sensor_frames_follow_tip_axes(hand: Hand, rng: np.random.Generator) -> None:
    angles = angles_of(hand, rng)
    frames, sensors = forward_kinematics(hand, np.eye(4), angles), sensor_poses(hand, np.eye(4), angles)
    for mount, sensor in zip(hand.sensors, sensors, strict=True):
        tip = frames[mount.link]
        np.testing.assert_allclose(sensor[:3, 2], tip[:3, 0], atol=1e-12)  # outward is tip +x
        np.testing.assert_allclose(sensor[:3, 0], tip[:3, 1], atol=1e-12)  # columns run along tip +y
        np.testing.assert_allclose(sensor[:3, 1], tip[:3, 2], atol=1e-12)  # rows along tip +z
        np.testing.assert_allclose(sensor[:3, 3], (tip @ [0.0117, 0, 0.0155, 1])[:3], atol=1e-12)


def test_bent_fingers_move_to_the_palms_side(hand: Hand) -> None:
    straight = np.clip(np.zeros(16), hand.lower, hand.upper)
    bent = straight.copy()
    bent[[1, 5, 9]] = 0.8
    moved = sensor_poses(hand, np.eye(4), bent)[:3, :3, 3] - sensor_poses(hand, np.eye(4), straight)[:3, :3, 3]
    assert (moved @ hand.palm_facing > 0.05).all()


def test_gel_has_a_visual_and_no_collision_shape(hand: Hand) -> None:
    tip = hand.sensors[0].link
    drawn = np.concatenate([mesh.vertices for link, mesh in hand.visual_meshes if link == tip])
    assert drawn[:, 0].max() == pytest.approx(0.0185, abs=1e-5)
    (box,) = hand.links[tip].collisions
    assert box.origin[0, 3] + box.size[0] / 2 == pytest.approx(0.0117)

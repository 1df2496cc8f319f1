"""Forward kinematics against PyBullet, and sensor frames."""

import sys

import numba
import numpy as np
import pybullet
import pytest

from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.kinematics import FEW_POSTURES, combine_frames, forward_kinematics, sensor_poses
from pipeline.kernels.hand.model import Hand
from tests.kernels.hand.meshes import random_pose

FLOAT32 = 2e-6  # precision of PyBullet's poses, m


def angles_of(hand: Hand, rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.uniform(hand.lower, hand.upper, (*shape, len(hand.joint_names)))


def test_forward_kinematics_links_match_pybullet(hand: Hand, rng: np.random.Generator) -> None:
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(hand.model), useFixedBase=True, physicsClientId=client)
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


def test_combined_frames_have_the_bits_of_composed_ones(hand: Hand, rng: np.random.Generator) -> None:
    frames, pose = forward_kinematics(hand, np.eye(4), angles_of(hand, rng, 9)), random_pose(rng)
    rows = rng.integers(9, size=(20, len(hand.links)))
    combined = combine_frames(pose, frames, rows)
    np.testing.assert_array_equal(combined, compose(pose, frames[rows, np.arange(len(hand.links))]))


def test_sensor_frames_follow_tip_axes(hand: Hand, rng: np.random.Generator) -> None:
    angles = angles_of(hand, rng)
    frames, sensors = forward_kinematics(hand, np.eye(4), angles), sensor_poses(hand, np.eye(4), angles)
    for mount, sensor in zip(hand.sensors, sensors, strict=True):
        tip = frames[mount.link]
        np.testing.assert_allclose(sensor[:3, 2], tip[:3, 0], atol=1e-12)  # outward is tip +x
        np.testing.assert_allclose(sensor[:3, 0], tip[:3, 1], atol=1e-12)  # columns run along tip +y
        np.testing.assert_allclose(sensor[:3, 1], tip[:3, 2], atol=1e-12)  # rows along tip +z
        np.testing.assert_allclose(sensor[:3, 3], (tip @ [0.0117, 0, 0.0155, 1])[:3], atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "angles", "named"),
    [
        (np.eye(4), np.full(16, np.nan), "allegro_right"),
        (np.eye(4) + np.inf, np.zeros(16), "allegro_right"),
        (np.eye(4), np.zeros(15), r"\(15,\).* 16"),
        (np.eye(4)[:3], np.zeros(16), r"\(3, 4\)"),
    ],
)
def test_kinematics_reject_wrong_shapes_and_infinite_values(hand: Hand, pose: np.ndarray, angles: np.ndarray, named: str) -> None:
    for function in (forward_kinematics, sensor_poses):
        with pytest.raises(ValueError, match=named):
            function(hand, pose, angles)


def test_few_postures_have_the_same_frames_in_a_process_without_numba(hand: Hand, rng: np.random.Generator, monkeypatch) -> None:
    poses, angles = np.stack([random_pose(rng) for _ in range(FEW_POSTURES)]), angles_of(hand, rng, FEW_POSTURES)
    compiled = forward_kinematics(hand, poses, angles)
    monkeypatch.delitem(sys.modules, numba.__name__)
    np.testing.assert_array_equal(forward_kinematics(hand, poses, angles), compiled)

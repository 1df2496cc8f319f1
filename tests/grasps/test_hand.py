"""The hand's model and kinematics."""

from __future__ import annotations

import math

import numpy as np
import pybullet
import pytest

from pipeline.kernels.hand.kinematics import forward, sensor_poses
from pipeline.kernels.hand.model import Hand

FLOAT32 = 2e-6  # PyBullet keeps poses in float32: 0.5e-6 was seen


def angles_of(hand: Hand, rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.uniform(hand.lower, hand.upper, (*shape, len(hand.joint_names)))


def pose_of(rng: np.random.Generator) -> np.ndarray:
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = rng.normal(size=3)
    return pose


def slow_tip(finger: str, angles: np.ndarray) -> np.ndarray:
    """A tip link's frame, written out from the table in the hand's documentation, one elementary motion after the other."""

    def shift(x: float, y: float, z: float) -> np.ndarray:
        return np.array([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])

    def turn(axis: str, angle: float) -> np.ndarray:
        c, s = math.cos(angle), math.sin(angle)
        rows = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]], "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}
        matrix = np.eye(4)
        matrix[:3, :3] = rows[axis]
        return matrix

    if finger == "thumb":
        a, b, c, d = angles[12:16]
        base = shift(-0.0182, 0.019333, -0.045987) @ turn("z", -1.5707963) @ turn("y", -1.6580628) @ turn("x", -a)
        upper = base @ shift(-0.027, 0.005, 0.0399) @ turn("z", b) @ shift(0, 0, 0.0177) @ turn("y", c)
        return upper @ shift(0, 0, 0.0514) @ turn("y", d) @ shift(0, 0, 0.0303)
    first = {"index": 0, "middle": 4, "ring": 8}[finger]
    y, z, roll = {"index": (0.0435, -0.001542, -0.0872665), "middle": (0, 0.0007, 0), "ring": (-0.0435, -0.001542, 0.0872665)}[finger]
    a, b, c, d = angles[first : first + 4]
    lower = shift(0, y, z) @ turn("x", roll) @ turn("z", a) @ shift(0, 0, 0.0164) @ turn("y", b)
    return lower @ shift(0, 0, 0.054) @ turn("y", c) @ shift(0, 0, 0.0384) @ turn("y", d) @ shift(0, 0, 0.0147)


def test_tips_stand_where_the_table_says(hand: Hand, rng: np.random.Generator) -> None:
    for _ in range(20):
        pose, angles = pose_of(rng), angles_of(hand, rng)
        frames = forward(hand, pose, angles)
        for finger in hand.fingers:
            np.testing.assert_allclose(frames[finger.tip], pose @ slow_tip(finger.name, angles), atol=1e-12)


def test_links_stand_where_pybullet_has_them(hand: Hand, rng: np.random.Generator) -> None:
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
            for frame, link in zip(forward(hand, np.eye(4), angles)[1:], hand.links[1:], strict=True):
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


def test_batches_broadcast(hand: Hand, rng: np.random.Generator) -> None:
    poses, angles = np.stack([pose_of(rng) for _ in range(3)]), angles_of(hand, rng, 2, 3)
    frames = forward(hand, poses, angles)
    assert frames.shape == (2, 3, len(hand.links), 4, 4)
    np.testing.assert_array_equal(frames[1, 2], forward(hand, poses[2], angles[1, 2]))


def test_sensors_look_out_of_the_tips(hand: Hand, rng: np.random.Generator) -> None:
    angles = angles_of(hand, rng)
    frames, sensors = forward(hand, np.eye(4), angles), sensor_poses(hand, np.eye(4), angles)
    for finger, sensor in zip(hand.fingers, sensors, strict=True):
        tip = frames[finger.tip]
        np.testing.assert_allclose(sensor[:3, 2], tip[:3, 0], atol=1e-12)  # outward is tip +x
        np.testing.assert_allclose(sensor[:3, 0], tip[:3, 1], atol=1e-12)  # columns run along tip +y
        np.testing.assert_allclose(sensor[:3, 1], tip[:3, 2], atol=1e-12)  # rows along tip +z
        np.testing.assert_allclose(sensor[:3, 3], (tip @ [0.0117, 0, 0.0155, 1])[:3], atol=1e-12)


def test_fingers_close_toward_the_palms_side(hand: Hand) -> None:
    straight = np.clip(np.zeros(16), hand.lower, hand.upper)
    bent = straight.copy()
    bent[[1, 5, 9]] = 0.8
    moved = sensor_poses(hand, np.eye(4), bent)[:3, :3, 3] - sensor_poses(hand, np.eye(4), straight)[:3, :3, 3]
    assert (moved @ hand.palm_facing > 0.05).all()


def test_the_gel_is_drawn_and_does_not_collide(hand: Hand) -> None:
    tip = hand.fingers[0].tip
    drawn = np.concatenate([mesh.vertices for link, mesh in hand.visual_meshes if link == tip])
    assert drawn[:, 0].max() == pytest.approx(0.0185, abs=1e-5)
    (box,) = hand.links[tip].collisions
    assert box.origin[0, 3] + box.size[0] / 2 == pytest.approx(0.0117)

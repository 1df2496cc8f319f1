"""Postures in which two gels face each other, checked independently of the search."""

import numpy as np
import pytest

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.collision_shapes import collision_spheres
from pipeline.kernels.hand.grasp_ik import GraspIk, prepare_grasp_ik
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.hand.pinches import opposed_postures
from pipeline.kernels.hand.self_collision import fingers_apart


def ik_of(name: str) -> GraspIk:
    hand = load_hand(name)
    spheres = collision_spheres(hand, spacing=0.006, tolerance=0.002)
    sensors = [load_sensor(mount.sensor) for mount in hand.sensors]
    return prepare_grasp_ik(hand, spheres, sensors, samples=512, clearance=0.001, finger_gap=0.001)


@pytest.mark.parametrize(("name", "widest"), [("allegro_right", 0.15), ("two_finger_gripper", 0.05)])
def test_gels_face_each_other_across_the_width(name: str, widest: float) -> None:
    ik = ik_of(name)
    found = opposed_postures(ik)
    hand, rows = ik.hand, np.arange(len(found.width))
    poses = sensor_poses(hand, np.eye(4), found.joint_angles)
    first, second = (poses[rows, found.sensors[:, side]] for side in (0, 1))
    facing = -(first[:, :3, 2] * second[:, :3, 2]).sum(axis=1)
    assert np.rad2deg(np.arccos(facing.min())) < 30 + 1e-6
    np.testing.assert_allclose((first[:, :3, 3] + second[:, :3, 3]) / 2, found.centre, atol=0.01)  # gels are a few millimetres thick
    assert (np.diff(found.width) >= 0).all()
    assert found.width[0] < 0.02
    assert found.width[-1] > widest
    assert ((found.joint_angles >= hand.lower) & (found.joint_angles <= hand.upper)).all()
    for pair in np.unique(found.sensors, axis=0):
        own = (found.sensors == pair).all(axis=1)
        fingers = [int(hand.link_fingers[hand.sensors[sensor].link]) for sensor in pair]
        frames = forward_kinematics(hand, np.eye(4), found.joint_angles[own])
        assert fingers_apart(hand, ik.boxes, frames, fingers, 0.001).all()

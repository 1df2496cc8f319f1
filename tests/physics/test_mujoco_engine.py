"""MuJoCo with a real hand: nothing pushes its links but its motors and the object."""

import numpy as np
import trimesh

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.model import Hand
from pipeline.physics.mujoco_engine import MujocoHoldTest
from tests.kernels.hand.meshes import centred, points_on


def test_hand_without_contact_keeps_its_posture(hand: Hand) -> None:
    """A palm that does not move must not collide with the fingers' first links, which it carries."""
    far, pose = centred(trimesh.creation.box((0.05, 0.05, 0.05))), np.eye(4)
    pose[0, 3] = 1.0
    angles = (hand.lower + hand.upper) / 2
    with MujocoHoldTest(hand, load_worn_sensors(sensor_names(hand, None)), mass=0.2) as test:
        test.load(far, points_on(far, 500, seed=0)[0])
        grasp = StoredGrasp(pose, angles, angles, angles, [None] * len(hand.sensors))
        motion = test.hold(grasp, acceleration=(0.0, 0.0, 0.0), seconds=0.2)
    np.testing.assert_allclose(motion.joint_angles[-1], angles, atol=1e-3)
    assert motion.moved < 1e-6
    assert motion.penetration == 0

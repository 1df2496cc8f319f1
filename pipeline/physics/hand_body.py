"""The hand as a body in PyBullet: fixed in the world by its root link, its fingers driven by motors."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy

from pipeline.kernels.arrays import Array
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import close_links
from pipeline.physics.client import PhysicsClient, pybullet

MOTOR_GAIN = 0.3
"""Share of the remaining distance that a position motor covers in one step: it closes 0.3 rad to within 1e-4 in about 25 steps."""
GEAR_FORCE = 1000.0  # N m (N), with which a joint is held to its leader: as rigid as a gear
GEAR_ERP, CHAIN_ERP = 0.5, 5.0
"""Correction of a gear's error, of which Bullet takes a fifth per step: between two branches; and in one chain, all of it at once.

At a tenth per step, a joint that follows one further up its own finger sags under its links' weight by more than `GEAR_SLACK`."""
HULL_MARGIN = 0.001  # m by which Bullet thickens the convex shapes of a URDF
GEAR_SLACK = 0.01  # rad by which a following joint may be off when the fingers rest: 0.5 mm at the end of 50 mm
SLIDE = 10.0
"""rad/m, by which motions of prismatic joints are compared with rotations: a point 0.1 m from the axis moves as far."""


class HandBody:
    """A hand that a client has loaded; `links` are PyBullet's numbers of the hand's links, `motors` those of its joint vector."""

    def __init__(self, client: PhysicsClient, hand: Hand, urdf: Path) -> None:
        self.client, self.hand = client, hand
        flags = pybullet.URDF_USE_SELF_COLLISION | pybullet.URDF_IGNORE_VISUAL_SHAPES | pybullet.URDF_USE_INERTIA_FROM_FILE
        self.body = client.loadURDF(str(urdf), useFixedBase=True, flags=flags)
        infos = [client.getJointInfo(self.body, joint) for joint in range(client.getNumJoints(self.body))]
        self.numbers = {hand.links[0].name: -1} | {info[12].decode(): info[0] for info in infos}  # by the link that each moves
        self.links = [self.numbers[link.name] for link in hand.links]
        self.motors = [self.links[link] for link in hand.joint_links]
        self._weights = [_weight(hand, link) for link in hand.joint_links]
        for link in self.links:
            client.changeDynamics(self.body, link, lateralFriction=hand.friction)
        for first, second in _untested_pairs(hand):
            client.setCollisionFilterPair(self.body, self.body, self.links[first], self.links[second], 0)
        self._followers = [self._couple(number) for number in range(len(hand.followers))]

    def _couple(self, number: int) -> int:
        """Couple a following joint to its leader, as a gear does; return its number."""
        follower = self.hand.followers[number]
        leader: int = self.motors[follower.entry]
        joint: int = self.links[follower.link]
        self.client.setJointMotorControl2(self.body, joint, pybullet.VELOCITY_CONTROL, force=0)
        frame = [0.0, 0.0, 0.0]
        gear = self.client.createConstraint(self.body, leader, self.body, joint, pybullet.JOINT_GEAR, [0, 1, 0], frame, frame)
        ratio = -1 / follower.multiplier  # Bullet holds leader + ratio * follower at the target
        offset = ratio * follower.offset
        erp = CHAIN_ERP if self._is_above(self.hand.joint_links[follower.entry], follower.link) else GEAR_ERP
        self.client.changeConstraint(gear, gearRatio=ratio, erp=erp, relativePositionTarget=offset, maxForce=GEAR_FORCE)
        return joint

    def _is_above(self, upper: int, link: int) -> bool:
        while link > upper:  # parents come before children
            link = self.hand.joints[link - 1].parent
        return link == upper

    def set_pose(
        self,
        hand_pose: Array,  # (4, 4) root link's frame to world, m
        start: Array,  # (J,) rad, at once
        target: Array,  # (J,) rad, to which the motors drive
    ) -> None:
        """Set the pose and posture of the hand, and the targets of its motors."""
        client = self.client
        # PyBullet takes the pose of the root's inertial frame; the pose given is that of the URDF frame.
        offset, turn = client.getDynamicsInfo(self.body, -1)[3:5]
        quaternion = scipy.spatial.transform.Rotation.from_matrix(hand_pose[:3, :3]).as_quat().tolist()
        base = pybullet.multiplyTransforms(hand_pose[:3, 3].tolist(), quaternion, offset, turn)
        client.resetBasePositionAndOrientation(self.body, *base)
        following = [joint.multiplier * start[joint.entry] + joint.offset for joint in self.hand.followers]
        for motor, angle in zip([*self.motors, *self._followers], [*start.tolist(), *map(float, following)], strict=True):
            client.resetJointState(self.body, motor, angle)
        self.drive(target)

    def drive(self, target: Array) -> None:
        """Set the targets (J,) of the motors, rad."""
        self.client.setJointMotorControlArray(
            self.body,
            self.motors,
            pybullet.POSITION_CONTROL,
            targetPositions=target.tolist(),
            forces=[self.hand.torque] * len(self.motors),
            positionGains=[MOTOR_GAIN] * len(self.motors),
        )

    def joint_states(self) -> tuple[Array, float]:
        """Read the joint vector (J,), rad (m), and the greatest speed of a joint, rad/s; of a prismatic one, times `SLIDE`."""
        states = self.client.getJointStates(self.body, self.motors)
        speeds = [weight * abs(state[1]) for weight, state in zip(self._weights, states, strict=True)]
        return np.array([state[0] for state in states]), max(speeds)

    def gears_hold(self, angles: Array) -> bool:
        """Return whether every following joint is where its leader puts it."""
        for follower, joint in zip(self.hand.followers, self._followers, strict=True):
            error = self.client.getJointState(self.body, joint)[0] - (follower.multiplier * angles[follower.entry] + follower.offset)
            if abs(error) * _weight(self.hand, follower.link) > GEAR_SLACK:
                return False
        return True


def _weight(hand: Hand, link: int) -> float:
    return SLIDE if hand.joints[link - 1].kind == "prismatic" else 1.0


@lru_cache(maxsize=4)
def _untested_pairs(hand: Hand) -> frozenset[tuple[int, int]]:
    """Find the pairs of links that may touch, or lie so close side by side that their hulls would push them apart."""
    return hand.allowed_contacts | close_links(hand, collision_boxes(hand), 2 * HULL_MARGIN).keys()

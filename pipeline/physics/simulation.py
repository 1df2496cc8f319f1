"""PyBullet: a hand that is fixed in the world by its root link, and closing its fingers on an object until contact settles."""

import os
import sys
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
import scipy

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import close_links
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_urdf import write_hand_urdf
from pipeline.store.temporary import temporary_folder

sys.stderr.flush()
_stderr = os.dup(2)
_null = os.open(os.devnull, os.O_WRONLY)
os.dup2(_null, 2)  # PyBullet prints its build time on import, which would look like a warning
try:
    import pybullet
    from pybullet_utils.bullet_client import BulletClient
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)
    os.close(_null)

__all__ = ["HandBody", "HandPhysics", "PhysicsClient", "Simulation", "pybullet"]
GRAVITY = -9.81  # m/s², along the world's z
FACES_PER_SHAPE = 131_072 // 3  # PyBullet refuses shapes of more than 131,072 vertices, and every face may have three of its own
COLLISION_MARGIN = 5e-4  # m around the object at which contact begins: half the clearance asked for, so that a clear posture stays
MOTOR_GAIN = 0.3  # share of the remaining distance covered in one step: a motor closes 0.3 rad to within 1e-4 in about 25 steps
GEAR_FORCE = 1000.0  # N m (N), with which a joint is held to its leader: as rigid as a gear
GEAR_ERP, CHAIN_ERP = 0.5, 5.0
"""Correction of a gear's error, of which Bullet takes a fifth per step: between two branches; and in one chain, all of it at once.

At a tenth per step, a joint that follows one further up its own finger sags under its links' weight by more than `GEAR_SLACK`."""
HULL_MARGIN = 0.001  # m by which Bullet thickens the convex meshes of a URDF, whatever `changeDynamics` is told
GEAR_SLACK = 0.01  # rad by which a following joint may be off when the fingers rest: 0.5 mm at the end of 50 mm
TREMOR, TREMOR_STEPS = 0.005, 48
"""rad within which the joints of a hand with gears may tremble, and steps of 1/240 s that they stay there, to count as resting.

Gear, motors and contact correct each other in turns, for ever if the contact moves from one edge of a face to the next: by 0.002 rad."""
SLIDE = 10.0  # rad/m, by which motions of prismatic joints are compared with rotations: a point 0.1 m from the axis moves as far
MIN_STEPS = 20  # steps before a hand can count as resting: it starts at rest
CHECK_EVERY = 10  # steps between two samples of the joints


class PhysicsClient(BulletClient):  # type: ignore[misc]
    """A client; `BulletClient` itself connects with empty options, for which PyBullet prints a line."""

    def __init__(self) -> None:
        self._client, self._pid = pybullet.connect(pybullet.DIRECT), os.getpid()
        self._points: list[list[float]] = []

    def create_shapes(self, mesh: Mesh) -> list[int]:
        """Make the collision shapes, concave as they are, of a mesh in world coordinates; return their numbers."""
        shapes = []
        for first in range(0, len(mesh.faces), FACES_PER_SHAPE):
            used, indices = np.unique(mesh.faces[first : first + FACES_PER_SHAPE], return_inverse=True)
            vertices, corners = self._as_lists(mesh.vertices[used]), indices.ravel().tolist()
            concave = pybullet.GEOM_FORCE_CONCAVE_TRIMESH
            shapes.append(self.createCollisionShape(pybullet.GEOM_MESH, vertices=vertices, indices=corners, flags=concave))
            vertices.clear()
            corners.clear()
        return shapes

    def _as_lists(self, vertices: Array) -> list[list[float]]:
        """List points (N, 3) in lists that are reused: PyBullet never frees those that it gets."""
        self._points += [[0.0, 0.0, 0.0] for _ in range(len(vertices) - len(self._points))]
        for point, vertex in zip(self._points, vertices.tolist(), strict=False):
            point[:] = vertex
        return self._points[: len(vertices)]


class HandBody:
    """A hand that a client has loaded; `links` are PyBullet's numbers of the hand's links, `motors` those of its joint vector."""

    def __init__(self, client: PhysicsClient, hand: Hand, urdf: Path) -> None:
        self.client, self.hand = client, hand
        flags = pybullet.URDF_USE_SELF_COLLISION | pybullet.URDF_IGNORE_VISUAL_SHAPES | pybullet.URDF_USE_INERTIA_FROM_FILE
        flags |= pybullet.URDF_USE_IMPLICIT_CYLINDER  # else a hull, with its margin
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
        upper, link = self.hand.joint_links[follower.entry], follower.link
        while link > upper:  # parents come before children
            link = self.hand.joints[link - 1].parent
        erp = CHAIN_ERP if link == upper else GEAR_ERP
        self.client.changeConstraint(gear, gearRatio=ratio, erp=erp, relativePositionTarget=ratio * follower.offset, maxForce=GEAR_FORCE)
        return joint

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
        following = [float(follower.of(start)) for follower in self.hand.followers]
        for motor, angle in zip([*self.motors, *self._followers], [*start.tolist(), *following], strict=True):
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

    def posture(self) -> Array:
        """Read all joints, (J + G,): the joint vector, then those that follow, rad (m)."""
        return np.array([state[0] for state in self.client.getJointStates(self.body, [*self.motors, *self._followers])])

    def gears_hold(self, posture: Array) -> bool:
        """Return whether in a posture (J + G,) every following joint is where its leader puts it."""
        angles, following = np.split(posture, [len(self.motors)])
        return all(
            abs(angle - follower.of(angles)) * _weight(self.hand, follower.link) <= GEAR_SLACK
            for follower, angle in zip(self.hand.followers, following, strict=True)
        )

    def trembles(self, postures: Array, resting_speed: float) -> bool:
        """Return whether in postures (T, J + G) all joints of a hand with gears tremble, and on the mean are slower than that, rad/s."""
        if len(postures) < TREMOR_STEPS:
            return False
        weights = [*self._weights, *(_weight(self.hand, follower.link) for follower in self.hand.followers)]
        first, second = (half.mean(axis=0) for half in np.split(postures, 2))
        moved = TREMOR_STEPS / 2 * resting_speed / 240  # from one half to the next
        return bool((np.ptp(postures, axis=0) * weights).max() <= TREMOR and (np.abs(second - first) * weights).max() <= moved)


def _weight(hand: Hand, link: int) -> float:
    return SLIDE if hand.joints[link - 1].kind == "prismatic" else 1.0


@lru_cache(maxsize=4)
def _untested_pairs(hand: Hand) -> frozenset[tuple[int, int]]:
    """Find the pairs of links that may touch, or lie so close side by side that their hulls would push them apart."""
    return hand.allowed_contacts | close_links(hand, collision_boxes(hand), 2 * HULL_MARGIN).keys()


class HandPhysics:
    """A PyBullet client of its own for a hand, which plates for its sensors' gels may belong to."""

    def __init__(self, hand: Hand, sensors: Sequence[Sensor] = ()) -> None:
        self.hand, self.sensors = hand, sensors
        self.elastic = any(sensor.gel is not None for sensor in sensors)
        self._opened = ExitStack()
        self._open()

    def _open(self) -> None:
        self.client = PhysicsClient()
        self._opened.callback(lambda: self.client.disconnect())  # reading the attribute here would make the client forget its number
        folder = self._opened.enter_context(temporary_folder())
        self._urdf = write_hand_urdf(self.hand, folder, self.sensors, rotors=self.elastic, margin=HULL_MARGIN)
        self._body: HandBody

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()


class Simulation(HandPhysics):
    """A hand and an object, both fixed in the world; only the fingers move."""

    def load(self, mesh: Mesh) -> None:
        """Replace everything by the hand and an object that collides as it is, concave, and never moves."""
        self.client.resetSimulation()  # bodies that are removed one by one leave memory behind
        self.client.setGravity(0.0, 0.0, GRAVITY)
        for shape in self.client.create_shapes(mesh):
            self.client.changeDynamics(self.client.createMultiBody(0, shape), -1, collisionMargin=COLLISION_MARGIN)
        self._body = HandBody(self.client, self.hand, self._urdf)

    def settle(
        self,
        hand_pose: Array,  # (4, 4) root link's frame to world; the root does not move
        start: Array,  # (J,) rad
        target: Array,  # (J,) rad
        *,
        max_steps: int,  # of 1/240 s
        resting_speed: float,  # rad/s, below which all joints count as resting; those that slide, below a tenth of it in m/s
    ) -> tuple[Array, bool]:
        """Close the fingers from one posture towards another; return the joint angles (J,), and whether they came to rest in time.

        A hand with gears rests in the mean of a tremor.
        """
        body, recent = self._body, deque[Array](maxlen=TREMOR_STEPS)
        body.set_pose(hand_pose, start, target)
        for step in range(1, max_steps + 1):
            self.client.stepSimulation()
            if self.hand.followers:
                recent.append(body.posture())
            if step >= MIN_STEPS and (step % CHECK_EVERY == 0 or step == max_steps):
                angles, speed = body.joint_states()
                if speed < resting_speed:
                    return angles, body.gears_hold(body.posture())
                if recent and body.trembles(np.array(recent), resting_speed):
                    mean = np.mean(recent, axis=0)
                    return mean[: len(angles)], body.gears_hold(mean)
        return body.joint_states()[0], False

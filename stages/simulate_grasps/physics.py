"""Closing the hand on an object and letting contact settle, in PyBullet."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.config.physics_urdf import write_physics_urdf
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from stages.simulate_grasps.quiet_pybullet import PhysicsClient, pybullet

FACES_PER_BODY = 131_072 // 3
"""PyBullet refuses shapes of more than 131,072 vertices, and every face may have three of its own: larger ones become several bodies."""
GRAVITY = -9.81
"""m/s², along the world's z."""
MOTOR_GAIN = 0.3
"""Share of the remaining way that a position motor asks for in one step: closes 0.3 rad to within 1e-4 in about 25 steps."""
COLLISION_MARGIN = 5e-4
"""m around the object at which contact begins: half the clearance asked for, so that a posture with clearance is left as it is."""
MIN_STEPS = 20
"""Steps before a hand can count as resting: it starts at rest."""
CHECK_EVERY = 10
"""Steps between two looks at the joints."""
GEAR_FORCE = 1000.0
"""N m (N), with which a joint is held to the one that it follows: as rigid as a gear."""
GEAR_SLACK = 0.01
"""rad that a following joint may be off where the fingers rest: 0.5 mm at the end of 50 mm; of a prismatic joint a tenth of that in m."""


class Simulation(AbstractContextManager["Simulation"]):
    """One PyBullet client with the hand and an object, both fixed in the world; only the fingers move.

    It has no window. Use it as a context manager, which disconnects the client.
    """

    def __init__(self, hand: Hand) -> None:
        self.hand = hand
        self.client = PhysicsClient()
        self._folder = TemporaryDirectory(prefix="vt-pipeline-hand-")
        self._urdf = write_physics_urdf(hand, Path(self._folder.name))
        self._body = -1
        self._motors: list[int] = []
        self._followers: list[int] = []
        self._points: list[list[float]] = []

    def __exit__(self, *_: object) -> None:
        self.client.disconnect()
        self._folder.cleanup()

    def load(self, mesh: Mesh) -> None:
        """Replace everything by the hand and an object that collides as it is, concave, and never moves.

        The client is reset first: bodies that are removed one by one leave memory behind.
        """
        client = self.client
        client.resetSimulation()
        client.setGravity(0, 0, GRAVITY)
        for first in range(0, len(mesh.faces), FACES_PER_BODY):
            used, indices = np.unique(mesh.faces[first : first + FACES_PER_BODY], return_inverse=True)
            vertices, corners = self._as_lists(mesh.vertices[used]), indices.ravel().tolist()
            shape = client.createCollisionShape(
                pybullet.GEOM_MESH, vertices=vertices, indices=corners, flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH
            )
            vertices.clear()
            corners.clear()
            body = client.createMultiBody(0, shape)
            client.changeDynamics(body, -1, collisionMargin=COLLISION_MARGIN)
        flags = pybullet.URDF_USE_SELF_COLLISION | pybullet.URDF_IGNORE_VISUAL_SHAPES
        self._body = client.loadURDF(str(self._urdf), useFixedBase=True, flags=flags)
        infos = [client.getJointInfo(self._body, joint) for joint in range(client.getNumJoints(self._body))]
        numbers = {self.hand.links[0].name: -1} | {info[12].decode(): info[0] for info in infos}  # by the link that each moves
        links = [numbers[link.name] for link in self.hand.links]
        self._motors = [links[link] for link in self.hand.joint_links]
        for link in links:
            client.changeDynamics(self._body, link, lateralFriction=self.hand.friction)
        for first, second in self.hand.allowed_contacts:
            client.setCollisionFilterPair(self._body, self._body, links[first], links[second], 0)
        self._couple(links)

    def _couple(self, links: list[int]) -> None:
        """Hold every joint that follows another one to it, as a gear does."""
        client, self._followers = self.client, []
        for follower in self.hand.followers:
            leader, joint = self._motors[follower.entry], links[follower.link]
            client.setJointMotorControl2(self._body, joint, pybullet.VELOCITY_CONTROL, force=0)
            frame = [0.0, 0.0, 0.0]
            gear = client.createConstraint(self._body, leader, self._body, joint, pybullet.JOINT_GEAR, [0, 1, 0], frame, frame)
            ratio = -1 / follower.multiplier  # Bullet holds leader + ratio * follower at the target
            client.changeConstraint(gear, gearRatio=ratio, erp=0.5, relativePositionTarget=ratio * follower.offset, maxForce=GEAR_FORCE)
            self._followers.append(joint)

    def _as_lists(self, vertices: NDArray[np.float64]) -> list[list[float]]:
        """Fill the same lists again and again: PyBullet never gives back those that it is given."""
        self._points += [[0.0, 0.0, 0.0] for _ in range(len(vertices) - len(self._points))]
        for point, vertex in zip(self._points, vertices.tolist(), strict=False):
            point[:] = vertex
        return self._points[: len(vertices)]

    def settle(
        self,
        hand_pose: NDArray[np.float64],
        start: NDArray[np.float64],
        target: NDArray[np.float64],
        *,
        max_steps: int,
        resting_speed: float,
    ) -> tuple[NDArray[np.float64], bool]:
        """Close the fingers from one posture towards another and wait until they rest.

        Parameters
        ----------
        hand_pose
            (4, 4) root link's frame in the world; the root does not move.
        start, target
            (J,) rad.
        max_steps
            Of 1/240 s.
        resting_speed
            Below this all joints count as resting, rad/s.

        Returns
        -------
        joint_angles
            (J,) float64 as simulated, rad.
        rests
            Whether they rested in time.
        """
        client = self.client
        # PyBullet takes the pose of the root's inertial frame; the pose given is that of the URDF frame.
        offset, turn = client.getDynamicsInfo(self._body, -1)[3:5]
        quaternion = Rotation.from_matrix(hand_pose[:3, :3]).as_quat().tolist()
        base = pybullet.multiplyTransforms(hand_pose[:3, 3].tolist(), quaternion, offset, turn)
        client.resetBasePositionAndOrientation(self._body, *base)
        following = [one.multiplier * start[one.entry] + one.offset for one in self.hand.followers]
        for motor, angle in zip([*self._motors, *self._followers], [*start.tolist(), *map(float, following)], strict=True):
            client.resetJointState(self._body, motor, angle)
        client.setJointMotorControlArray(
            self._body,
            self._motors,
            pybullet.POSITION_CONTROL,
            targetPositions=target.tolist(),
            forces=[self.hand.torque] * len(self._motors),
            positionGains=[MOTOR_GAIN] * len(self._motors),
        )
        return self.advance(max_steps=max_steps, resting_speed=resting_speed)

    def advance(self, *, max_steps: int, resting_speed: float) -> tuple[NDArray[np.float64], bool]:
        """Step on until the joints rest; arguments and result as for `settle`."""
        for step in range(1, max_steps + 1):
            self.client.stepSimulation()
            if step >= MIN_STEPS and (step % CHECK_EVERY == 0 or step == max_steps):
                states = self.client.getJointStates(self._body, self._motors)
                if max(abs(state[1]) for state in states) < resting_speed:
                    angles = np.array([state[0] for state in states])
                    return angles, self._gears_hold(angles)
        return np.array([state[0] for state in self.client.getJointStates(self._body, self._motors)]), False

    def _gears_hold(self, angles: NDArray[np.float64]) -> bool:
        """Tell whether every joint that follows another one is where that puts it."""
        for follower, joint in zip(self.hand.followers, self._followers, strict=True):
            slack = GEAR_SLACK / (10 if self.hand.joints[follower.link - 1].kind == "prismatic" else 1)
            off = self.client.getJointState(self._body, joint)[0] - (follower.multiplier * angles[follower.entry] + follower.offset)
            if abs(off) > slack:
                return False
        return True

"""The hand, the object and how contact settles, in PyBullet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from stages.simulate_grasps.bullet import pybullet

FACES_A_BODY = 131_072 // 3
"""PyBullet refuses shapes of more than 131,072 vertices, and every face may have three of its own: larger ones become several bodies."""
GRAVITY = -9.81
"""m/s², along the world's z."""
MOTOR_FORCE = 0.7
"""N m (N for a prismatic joint): the Allegro's rated joint torque."""
MOTOR_GAIN = 0.3
"""Share of the remaining way that a position motor asks for in one step: closes 0.3 rad to within 1e-4 in about 25 steps."""
COLLISION_MARGIN = 5e-4
"""m around the object at which contact begins: half the clearance asked for, so that a posture with room is left as it is."""
CHECK_EVERY = 10
"""Steps between two looks at the joints."""


class Simulation:
    """One PyBullet client with the hand, and at most one object, both of which stay where they are; only the fingers move."""

    def __init__(self, hand: Hand, client: int) -> None:
        self.hand = hand
        self.client = client
        self._body = -1
        self._motors: list[int] = []

    def load(self, mesh: Mesh) -> None:
        """Start afresh with the hand and an object that collides as it is, concave, and never moves.

        Everything is reset first: bodies that are removed one by one leave memory behind.
        """
        client = {"physicsClientId": self.client}
        pybullet.resetSimulation(**client)
        pybullet.setGravity(0, 0, GRAVITY, **client)
        for first in range(0, len(mesh.faces), FACES_A_BODY):
            used, indices = np.unique(mesh.faces[first : first + FACES_A_BODY], return_inverse=True)
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_MESH,
                vertices=mesh.vertices[used].tolist(),
                indices=indices.ravel().tolist(),
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
                **client,
            )
            body = pybullet.createMultiBody(0, shape, **client)
            pybullet.changeDynamics(body, -1, collisionMargin=COLLISION_MARGIN, **client)
        flags = pybullet.URDF_USE_SELF_COLLISION | pybullet.URDF_IGNORE_VISUAL_SHAPES
        self._body = pybullet.loadURDF(str(self.hand.urdf), useFixedBase=True, flags=flags, **client)
        infos = [pybullet.getJointInfo(self._body, joint, **client) for joint in range(pybullet.getNumJoints(self._body, **client))]
        numbers = {info[1].decode(): info[0] for info in infos}
        self._motors = [numbers[name] for name in self.hand.joint_names]

    def settle(
        self,
        hand_pose: NDArray[np.float64],
        start: NDArray[np.float64],
        target: NDArray[np.float64],
        steps: tuple[int, int],
        speed: float,
    ) -> tuple[NDArray[np.float64], bool]:
        """Close the fingers from `start` towards `target` and wait until they rest.

        Parameters
        ----------
        hand_pose
            (4, 4) root link's frame in the world; the root does not move.
        start, target
            (J,) rad.
        steps
            The least and the most steps, of 1/240 s.
        speed
            Below this all joints count as resting, rad/s.

        Returns
        -------
        (J,) joint angles as simulated, rad, and whether they rested in time.
        """
        client = {"physicsClientId": self.client}
        # PyBullet places a body by its root's inertial frame; the pose is that of the URDF frame.
        offset, turn = pybullet.getDynamicsInfo(self._body, -1, **client)[3:5]
        quaternion = Rotation.from_matrix(hand_pose[:3, :3]).as_quat().tolist()
        base = pybullet.multiplyTransforms(hand_pose[:3, 3].tolist(), quaternion, offset, turn)
        pybullet.resetBasePositionAndOrientation(self._body, *base, **client)
        for motor, angle in zip(self._motors, start.tolist(), strict=True):
            pybullet.resetJointState(self._body, motor, angle, **client)
        pybullet.setJointMotorControlArray(
            self._body,
            self._motors,
            pybullet.POSITION_CONTROL,
            targetPositions=target.tolist(),
            forces=[MOTOR_FORCE] * len(self._motors),
            positionGains=[MOTOR_GAIN] * len(self._motors),
            **client,
        )
        return self.advance(steps, speed)

    def advance(self, steps: tuple[int, int], speed: float) -> tuple[NDArray[np.float64], bool]:
        """Let time pass; arguments and result as for `settle`."""
        client = {"physicsClientId": self.client}
        least, most = steps
        for step in range(1, most + 1):
            pybullet.stepSimulation(**client)
            if step >= least and (step % CHECK_EVERY == 0 or step == most):
                states = pybullet.getJointStates(self._body, self._motors, **client)
                if max(abs(state[1]) for state in states) < speed:
                    return np.array([state[0] for state in states]), True
        return np.array([state[0] for state in pybullet.getJointStates(self._body, self._motors, **client)]), False


@contextmanager
def simulation(hand: Hand) -> Iterator[Simulation]:
    """A simulation with a client of its own, without a window, that is disconnected at the end."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        yield Simulation(hand, client)
    finally:
        pybullet.disconnect(client)

"""The hold test in PyBullet, the engine that makes grasps."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.formats.physics_urdf import write_physics_urdf
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp_closure import Contact
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.gel_plates import GelSpring, add_gel_plates, gel_name, gel_spring
from pipeline.physics.hand_body import HandBody
from pipeline.physics.hold_test import HoldTest
from pipeline.physics.object_shapes import COLLISION_MARGIN, ObjectShapes
from pipeline.physics.quiet_pybullet import PhysicsClient, pybullet
from pipeline.store.temporary import temporary_folder

STEPS_PER_SECOND = 240
LOCK_FORCE = 1000.0
"""N that hold the plate of a gel without contact where it is drawn in."""


class PybulletHoldTest(HoldTest):
    """`HoldTest` in PyBullet, in one client. The object collides as it is, concave."""

    look_interval = 5 / STEPS_PER_SECOND

    def __init__(
        self, hand: Hand, sensors: Sequence[Sensor], *, mass: float, friction: float | None = None, torsion: float | None = None
    ) -> None:
        super().__init__(hand, sensors, mass=mass, friction=friction, torsion=torsion)
        self.client = PhysicsClient()
        self.opened.callback(lambda: self.client.disconnect())  # reading the attribute here would make the client forget its number
        self._urdf = write_physics_urdf(hand, self.opened.enter_context(temporary_folder()))
        add_gel_plates(self._urdf, hand, sensors)
        self._shapes = ObjectShapes(self.client)
        self._start: tuple[list[float], list[float]]
        self._springs: list[GelSpring]

    def load(self, mesh: Mesh, points: NDArray[np.float64]) -> None:
        """Replace everything by the hand and an object; see `HoldTest.load`."""
        client = self.client
        client.resetSimulation()
        base_shape, *link_shapes = self._shapes.create(mesh)
        centre = points.mean(axis=0)
        squares = ((points - centre) ** 2).mean(axis=0)
        zeros, identity = [[0.0, 0.0, 0.0]] * len(link_shapes), [[0.0, 0.0, 0.0, 1.0]] * len(link_shapes)
        self._object = client.createMultiBody(
            self.mass,
            base_shape,
            baseInertialFramePosition=centre.tolist(),
            linkMasses=[0.0] * len(link_shapes),
            linkCollisionShapeIndices=link_shapes,
            linkVisualShapeIndices=[-1] * len(link_shapes),
            linkPositions=zeros,
            linkOrientations=identity,
            linkInertialFramePositions=zeros,
            linkInertialFrameOrientations=identity,
            linkParentIndices=[0] * len(link_shapes),
            linkJointTypes=[pybullet.JOINT_FIXED] * len(link_shapes),
            linkJointAxis=zeros,
        )
        inertia = (self.mass * (squares.sum() - squares)).tolist()  # Bullet computes none for a concave shape
        client.changeDynamics(self._object, -1, localInertiaDiagonal=inertia)
        for body_part in range(-1, len(link_shapes)):  # friction coefficients are multiplied: the hand's counts
            client.changeDynamics(self._object, body_part, collisionMargin=COLLISION_MARGIN, lateralFriction=1.0)
        self._start = (centre.tolist(), [0.0, 0.0, 0.0, 1.0])
        self._hand = HandBody(client, self.hand, self._urdf)
        for link in () if self.torsion is None else self._hand.links:
            client.changeDynamics(self._hand.body, link, spinningFriction=self.torsion)
        self._gels = [self._hand.numbers[gel_name(number)] for number in range(len(self.sensors))]
        for gel in self._gels:
            for collider in (*self._hand.links, *self._gels):
                client.setCollisionFilterPair(self._hand.body, self._hand.body, gel, collider, 0)

    def _begin(self, grasp: StoredGrasp, closes: bool) -> float:
        client, hand, start = self.client, self._hand, grasp.pregrasp if closes else grasp.joint_angles
        hand.place(grasp.hand_pose, start, start)
        self._springs = [self._press(number, contact, out=closes) for number, contact in enumerate(grasp.contacts)]
        client.resetBasePositionAndOrientation(self._object, *self._start)
        client.resetBaseVelocity(self._object, [0.0] * 3, [0.0] * 3)
        client.performCollisionDetection()
        return max(-min((point[8] for point in client.getContactPoints(self._object, hand.body)), default=0.0), 0.0)

    def _accelerate(self, acceleration: Sequence[float]) -> None:
        self.client.setGravity(*acceleration)

    def _drive(self, posture: NDArray[np.float64]) -> None:
        self._hand.drive(posture)

    def _step(self, seconds: float) -> None:
        """Advance the simulation, with the gels' springs."""
        body, gels, tops = self._hand.body, self._gels, [gel_top(sensor) for sensor in self.sensors]
        states, control, step = self.client.getJointStates, self.client.setJointMotorControlArray, self.client.stepSimulation
        for _ in range(round(seconds * STEPS_PER_SECOND)):
            forces = [
                spring.stiffness * max(top - height, 0.0) - spring.damping * speed
                for spring, top, (height, speed, *_) in zip(self._springs, tops, states(body, gels), strict=True)
            ]
            control(body, gels, pybullet.TORQUE_CONTROL, forces=forces)
            step()

    def _joint_angles(self) -> NDArray[np.float64]:
        return self._hand.joint_states()[0]

    def _object_pose(self) -> NDArray[np.float64]:
        return np.concatenate(self.client.getBasePositionAndOrientation(self._object))

    def _press(self, number: int, contact: Contact | None, *, out: bool) -> GelSpring:
        """Move a gel to its contact, or with `out` to its surface; return its spring."""
        sensor, gel = self.sensors[number], self._gels[number]
        spring = gel_spring(sensor, contact, friction=self.hand.friction, margin=COLLISION_MARGIN)
        twist = spring.torsion if self.torsion is None else self.torsion
        self.client.resetJointState(self._hand.body, gel, gel_top(sensor) if out and contact else spring.height)
        lock = 0.0 if contact else LOCK_FORCE
        self.client.setJointMotorControl2(self._hand.body, gel, pybullet.POSITION_CONTROL, targetPosition=0.0, force=lock)
        self.client.changeDynamics(self._hand.body, gel, lateralFriction=self.hand.friction, spinningFriction=twist)
        return spring

"""The hold test in PyBullet: how far an object that is freed in a grasp moves."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.physics_urdf import write_physics_urdf
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp_closure import Contact
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.gel_surface import gel_top
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.gel_plates import GelSpring, add_gel_plates, gel_name, gel_spring
from pipeline.physics.hand_body import HandBody
from pipeline.physics.motion import CLOSING_SECONDS, CLOSING_STAGES, Motion, Track, closing_path
from pipeline.physics.object_shapes import COLLISION_MARGIN, ObjectShapes
from pipeline.physics.quiet_pybullet import PhysicsClient, pybullet
from pipeline.physics.simulation import GRAVITY
from pipeline.store.temporary import temporary_folder

STEPS_PER_SECOND, STEPS_PER_LOOK = 240, 5


class HoldTest(AbstractContextManager["HoldTest"]):
    """One PyBullet client with a hand, fixed in the world, and an object that is free.

    Each gel is a plate on a spring (`gel_spring`), which touches the object where the tactile image has it nearest. A gel that does not
    touch is drawn in; rigid links are as in the grasp. Motors hold the posture with no more than the hand's torque.

    Parameters
    ----------
    hand, sensors
        The hand, and the sensor of each of its mounts.
    mass
        Of the object, kg.
    friction
        Coefficient between hand and object; by default the hand's.
    torsion
        Of every link and gel: the moment about the normal that friction resists per newton of normal force, m. By default that of the
        contact's area for gels, and none for links.
    """

    def __init__(
        self, hand: Hand, sensors: Sequence[Sensor], *, mass: float, friction: float | None = None, torsion: float | None = None
    ) -> None:
        self.hand = hand if friction is None else replace(hand, friction=friction)
        self.sensors, self.mass, self.torsion = sensors, mass, torsion
        self.client = PhysicsClient()
        self._folder = ExitStack()
        self._urdf = write_physics_urdf(hand, self._folder.enter_context(temporary_folder()))
        add_gel_plates(self._urdf, hand, sensors)
        self._shapes = ObjectShapes(self.client)
        self._start: tuple[list[float], list[float]]

    def __exit__(self, *_: object) -> None:
        self.client.disconnect()
        self._folder.close()

    def load(self, mesh: Mesh, points: NDArray[np.float64]) -> None:
        """Replace everything by the hand and an object, whose mass is spread evenly over its exterior points (N, 3)."""
        client = self.client
        client.resetSimulation()
        first, *others = self._shapes.create(mesh)
        centre = points.mean(axis=0)
        squares = ((points - centre) ** 2).mean(axis=0)
        none, straight = [[0.0, 0.0, 0.0]] * len(others), [[0.0, 0.0, 0.0, 1.0]] * len(others)
        self._object = client.createMultiBody(
            self.mass,
            first,
            baseInertialFramePosition=centre.tolist(),
            linkMasses=[0.0] * len(others),
            linkCollisionShapeIndices=others,
            linkVisualShapeIndices=[-1] * len(others),
            linkPositions=none,
            linkOrientations=straight,
            linkInertialFramePositions=none,
            linkInertialFrameOrientations=straight,
            linkParentIndices=[0] * len(others),
            linkJointTypes=[pybullet.JOINT_FIXED] * len(others),
            linkJointAxis=none,
        )
        inertia = (self.mass * (squares.sum() - squares)).tolist()  # Bullet knows none of a concave shape
        client.changeDynamics(self._object, -1, localInertiaDiagonal=inertia)
        for part in range(-1, len(others)):  # friction coefficients are multiplied: the hand's counts
            client.changeDynamics(self._object, part, collisionMargin=COLLISION_MARGIN, lateralFriction=1.0)
        self._start = (centre.tolist(), [0.0, 0.0, 0.0, 1.0])
        self._hand = HandBody(client, self.hand, self._urdf)
        for link in () if self.torsion is None else self._hand.links:
            client.changeDynamics(self._hand.body, link, spinningFriction=self.torsion)
        self._gels = [self._hand.numbers[gel_name(number)] for number in range(len(self.sensors))]
        for gel in self._gels:
            client.setJointMotorControl2(self._hand.body, gel, pybullet.VELOCITY_CONTROL, force=0)  # the motor that every joint has
            for other in (*self._hand.links, *self._gels):
                client.setCollisionFilterPair(self._hand.body, self._hand.body, gel, other, 0)

    def hold(
        self,
        hand_pose: NDArray[np.float64],
        joint_angles: NDArray[np.float64],
        contacts: Sequence[Contact | None],
        *,
        target: NDArray[np.float64] | None = None,
        pregrasp: NDArray[np.float64] | None = None,
        acceleration: Sequence[float] = (0.0, 0.0, GRAVITY),
        seconds: float = 1.0,
        limit: float = 0.1,
    ) -> Motion:
        """Free the object in a grasp and tell how far it moves.

        Parameters
        ----------
        hand_pose, joint_angles
            (4, 4) and (J,) of the grasp, world frame, m, rad.
        contacts
            Of each sensor, None where it does not touch.
        target
            (J,) that the motors drive to, the squeeze; by default the joint angles.
        pregrasp
            (J,) from which the fingers first close to the joint angles and to the target, in a straight line each and without gravity; by
            default they begin in the grasp.
        acceleration
            Of gravity on the object and the hand's links, world, m/s².
        seconds
            How long at most: an object that rests ends the test.
        limit
            m that the object's centre may move; beyond, the test ends early.
        """
        client, hand = self.client, self._hand
        goal = joint_angles if target is None else target
        hand.place(hand_pose, joint_angles if pregrasp is None else pregrasp, goal)
        springs = [self._press(number, contact, out=pregrasp is not None) for number, contact in enumerate(contacts)]
        client.resetBasePositionAndOrientation(self._object, *self._start)
        client.resetBaseVelocity(self._object, [0.0] * 3, [0.0] * 3)
        client.performCollisionDetection()
        penetration = -min((point[8] for point in client.getContactPoints(self._object, hand.body)), default=0.0)
        client.setGravity(0.0, 0.0, 0.0)
        for posture in closing_path(pregrasp, joint_angles, goal) if pregrasp is not None else ():
            hand.drive(posture)
            self._step(springs, round(CLOSING_SECONDS * STEPS_PER_SECOND / CLOSING_STAGES))
        client.setGravity(*acceleration)
        track = Track(np.concatenate(self._start), limit=limit)
        for _ in range(round(seconds * STEPS_PER_SECOND / STEPS_PER_LOOK)):
            self._step(springs, STEPS_PER_LOOK)
            if track.ends(np.concatenate(client.getBasePositionAndOrientation(self._object))):
                break
        return track.motion(max(penetration, 0.0))

    def _step(self, springs: Sequence[GelSpring], steps: int) -> None:
        """Step, with the gels' springs."""
        body, gels, tops = self._hand.body, self._gels, [gel_top(sensor) for sensor in self.sensors]
        states, control, step = self.client.getJointStates, self.client.setJointMotorControlArray, self.client.stepSimulation
        for _ in range(steps):
            forces = [
                spring.stiffness * max(top - height, 0.0) - spring.damping * speed
                for spring, top, (height, speed, *_) in zip(springs, tops, states(body, gels), strict=True)
            ]
            control(body, gels, pybullet.TORQUE_CONTROL, forces=forces)
            step()

    def _press(self, number: int, contact: Contact | None, *, out: bool) -> GelSpring:
        """Put a gel to its contact, or `out` to where it is not pressed in; its spring."""
        sensor, gel = self.sensors[number], self._gels[number]
        spring = gel_spring(sensor, contact, friction=self.hand.friction, margin=COLLISION_MARGIN)
        twist = spring.torsion if self.torsion is None else self.torsion
        self.client.resetJointState(self._hand.body, gel, gel_top(sensor) if out and contact else spring.height)
        self.client.changeDynamics(self._hand.body, gel, lateralFriction=self.hand.friction, spinningFriction=twist)
        return spring

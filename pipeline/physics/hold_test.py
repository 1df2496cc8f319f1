"""The hold test in PyBullet: how far an object that is freed in a grasp moves."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import SubElement, parse

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.formats.physics_urdf import write_physics_urdf
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.grasp_closure import Contact
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.gel_surface import gel_top
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_body import HandBody
from pipeline.physics.object_shapes import COLLISION_MARGIN, ObjectShapes
from pipeline.physics.quiet_pybullet import PhysicsClient, pybullet
from pipeline.physics.simulation import GRAVITY
from pipeline.store.temporary import temporary_folder

STEPS_PER_SECOND = 240
GEL_MODULUS = 1e5
"""Pa, Young's modulus of soft silicone. Pressed in by 2 mm over 60 mm², a gel of 7 mm presses back with 2 N."""
GEL_MASS = 0.02
"""kg, of a gel's plate: a lighter one swings on its spring faster than steps of 1/240 s can follow."""
DAMPING = 0.25
"""Of that spring, as a share of the critical one."""


@dataclass(frozen=True)
class Motion:
    """How far an object that was freed in a grasp has moved in the end: its centre, m, and its turn, rad; infinite where physics fails."""

    moved: float
    turned: float


class HoldTest(AbstractContextManager["HoldTest"]):
    """One PyBullet client with a hand, fixed in the world, and an object that is free.

    Each gel is a plate on a spring, which touches the object where the tactile image has it nearest. The spring is as stiff as an elastic
    layer with the touch's indentation (Winkler's foundation: pressure = modulus * indentation / thickness), friction about the normal is
    that of a disc of the contact's area. A gel that does not touch is left out; rigid links are as in the grasp. Motors hold the
    posture with no more than the hand's torque.

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
        _add_gels(self._urdf, hand, sensors)
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
        self._gels = [self._hand.numbers[_gel(number)] for number in range(len(self.sensors))]
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
        acceleration
            Of gravity, world, m/s².
        seconds
            How long.
        limit
            m that the object's centre may move; beyond, the test ends early.
        """
        client = self.client
        client.setGravity(*acceleration)
        client.resetBasePositionAndOrientation(self._object, *self._start)
        client.resetBaseVelocity(self._object, [0.0] * 3, [0.0] * 3)
        self._hand.place(hand_pose, joint_angles, joint_angles if target is None else target)
        stiffness = np.array([self._press(number, contact) for number, contact in enumerate(contacts)])
        out = np.array([gel_top(sensor) for sensor in self.sensors])
        motion = Motion(0.0, 0.0)
        for _ in range(round(seconds * STEPS_PER_SECOND)):
            height, speed = np.array([state[:2] for state in client.getJointStates(self._hand.body, self._gels)]).T
            forces = (stiffness * np.maximum(out - height, 0) - 2 * DAMPING * np.sqrt(stiffness * GEL_MASS) * speed).tolist()
            client.setJointMotorControlArray(self._hand.body, self._gels, pybullet.TORQUE_CONTROL, forces=forces)
            client.stepSimulation()
            motion = self._motion()
            if motion.moved > limit:
                break
        return motion

    def _motion(self) -> Motion:
        """Compare the object's pose with that at which it was loaded."""
        centre, turn = map(np.array, self.client.getBasePositionAndOrientation(self._object))
        moved = float(length(centre - self._start[0]))
        return Motion(moved, 2 * float(np.arctan2(length(turn[:3]), abs(turn[3])))) if np.isfinite(moved) else Motion(np.inf, np.inf)

    def _press(self, number: int, contact: Contact | None) -> float:
        """Put a gel to its contact; the stiffness of its spring, N/m."""
        sensor, gel = self.sensors[number], self._gels[number]
        height = max(contact.nearest - COLLISION_MARGIN, 0.0) if contact else 0.0
        self.client.resetJointState(self._hand.body, gel, height)
        if contact is None:
            return 0.0
        twist = 2 / 3 * self.hand.friction * float(np.sqrt(contact.area / np.pi)) if self.torsion is None else self.torsion
        self.client.changeDynamics(self._hand.body, gel, lateralFriction=self.hand.friction, spinningFriction=twist)
        return GEL_MODULUS / sensor.w * contact.volume / (gel_top(sensor) - height)


def _gel(number: int) -> str:
    return f"gel of sensor {number}"


def _add_gels(urdf: Path, hand: Hand, sensors: Sequence[Sensor]) -> None:
    """Add a plate per sensor to a hand's URDF, which slides along the sensor's normal from its plane to the gel's surface."""
    tree = parse(urdf)
    for number, (mount, sensor) in enumerate(zip(hand.sensors, sensors, strict=True)):
        link = SubElement(tree.getroot(), "link", name=_gel(number))
        inertial = SubElement(link, "inertial")
        SubElement(inertial, "mass", value=str(GEL_MASS))
        SubElement(inertial, "inertia", ixx="1e-6", iyy="1e-6", izz="1e-6", ixy="0", ixz="0", iyz="0")
        plate = SubElement(link, "collision")
        SubElement(plate, "origin", xyz=f"0 0 {-sensor.w / 2}")
        SubElement(SubElement(plate, "geometry"), "box", size=f"{sensor.width} {sensor.height} {sensor.w}")
        joint = SubElement(tree.getroot(), "joint", name=_gel(number), type="prismatic")
        SubElement(joint, "parent", link=hand.links[mount.link].name)
        SubElement(joint, "child", link=_gel(number))
        angles = Rotation.from_matrix(mount.pose[:3, :3]).as_euler("xyz")
        SubElement(joint, "origin", xyz=_text(mount.pose[:3, 3]), rpy=_text(angles))
        SubElement(joint, "axis", xyz="0 0 1")
        SubElement(joint, "limit", lower="0", upper=str(gel_top(sensor)), effort="1000", velocity="10")
    tree.write(urdf)


def _text(numbers: NDArray[np.float64]) -> str:
    return " ".join(repr(float(number)) for number in numbers)

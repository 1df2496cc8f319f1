"""The hold test: an object is freed in a grasp, its motion recorded, and judged as held or not."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.gel_balance import with_force
from pipeline.kernels.hand.grasp import Contact, Grasp
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.ray_depth import BoxedFaces, box_faces
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_urdf import GEL_MASS, gel_name
from pipeline.physics.simulation import COLLISION_MARGIN, GRAVITY, HandBody, HandPhysics, pybullet

DOWN = (0.0, 0.0, GRAVITY)
HOLD_TESTS = {"lift": (DOWN,), "six": tuple(tuple((sign * axis).tolist()) for axis in GRAVITY * np.eye(3) for sign in (1, -1))}
"""Accelerations under which an object must stay, one after the other, m/s²: its weight, or that along -x, +x, -y, +y, -z and +z."""
STEPS_PER_SECOND = 240
LOCK_FORCE = 1000.0  # N that hold the plate of a gel without contact where it is drawn in
GEL_MODULUS = 1e5  # Pa, Young's modulus of a gel whose file gives none: 7 mm of it, pressed in by 2 mm over 60 mm², press back with 2 N
MAX_STIFFNESS = 4e4  # N/m of an elastic gel's plate: steps of 1/240 s follow no stiffer one on a finger whose motor gives way
STEADY = 2.0  # mass of a plate over stiffness times the square of a step: an explicit step diverges below a quarter
DAMPING = 0.25  # damping of a gel's spring, as a share of the critical damping
OVERLAP = 1e-4  # m by which a plate starts in the object: engines find no contact of flat faces that only meet; a spring then overshoots
WITHIN, REST = 0.1, 0.05
"""m from where it was, and m/s, up to which an object is held at the end: then it rests in the hand. Motors and gels give way by up to
2 cm, some objects slip by up to 8 cm until they are caught, and what rests may creep at 1 cm/s; what falls is faster than 10 cm/s."""
RESTING_SAMPLES, RESTING_CHANGE = 12, 1e-3  # an object rests when its pose, m and quaternion, changes by less in as many samples, 0.25 s


def is_held(moved: ArrayLike, speed: ArrayLike) -> Mask:
    """Check whether objects are held, by how far, m, and how fast, m/s, they moved at the end."""
    return (np.asarray(moved) <= WITHIN) & (np.asarray(speed) <= REST)


@dataclass(frozen=True)
class Motion:
    """The motion of an object that was freed in a grasp: infinite if the engine's numbers overflow."""

    moved: float  # m, displacement of its centre at the end
    turned: float  # rad
    speed: float  # m/s, of its centre: its displacement in the last `RESTING_SAMPLES` samples
    penetration: float  # m, depth of the hand in the object at the start; in PyBullet's surface, only what crosses it counts


class Track:
    """Record the pose (7,) of a freed object, its centre, m, and its quaternion, every `interval`, s."""

    def __init__(self, pose: Array, *, limit: float, interval: float) -> None:
        self.poses, self.limit, self.interval = [pose], limit, interval

    def ends(self, pose: Array) -> bool:
        """Add a sample, and tell whether the object is beyond the limit or rests."""
        self.poses.append(pose)
        if not length(pose[:3] - self.poses[0][:3]) <= self.limit:  # NaN ends the test, too
            return True
        return len(self.poses) > RESTING_SAMPLES and bool(np.abs(pose - self.poses[-1 - RESTING_SAMPLES]).max() < RESTING_CHANGE)

    def motion(self, penetration: float) -> Motion:
        """Compare the last pose with the first."""
        first, last = self.poses[0], self.poses[-1]
        if not np.isfinite(last).all():
            return Motion(np.inf, np.inf, np.inf, penetration)
        # of unit quaternions, which have two signs
        difference = min(float(length(last[3:] - first[3:])), float(length(last[3:] + first[3:])))
        moved, turned = float(length(last[:3] - first[:3])), 4 * float(np.arcsin(min(difference / 2, 1.0)))
        recent = self.poses[-1 - RESTING_SAMPLES :]
        speed = float(length(last[:3] - recent[0][:3])) / (self.interval * max(len(recent) - 1, 1))
        return Motion(moved, turned, speed, penetration)


@dataclass(frozen=True)
class GelSpring:
    """The spring of a gel's plate in a contact: linear, or of an elastic gel as under a ball, with the square of the depth."""

    height: float = 0.0  # m, of the plate above the sensor plane where it meets the object
    stiffness: float = 0.0  # N/m there
    damping: float = 0.0  # N s/m
    torsion: float = 0.0  # m, moment about the normal that friction resists per newton of normal force
    mass: float = GEL_MASS  # kg of the plate
    travel: float = 0.0  # m that the plate of an elastic gel is pressed in there
    free: float | None = None  # m of its travel up to which it presses with nothing; None for a linear spring

    def force(self, travel: float) -> float:
        """Compute the force, N, of a plate that is pressed in by `travel`, m, or not; deeper than in the contact it grows evenly."""
        if self.free is None:
            return self.stiffness * max(travel, 0.0)
        depth, rest = max(max(travel, 0.0) - self.free, 0.0), self.travel - self.free
        return self.stiffness * (depth**2 / (2 * rest) if depth < rest else depth - rest / 2)


def gel_spring(
    sensor: Sensor,
    contact: Contact | None,
    *,
    friction: float,  # coefficient between gel and object
    margin: float = 0.0,  # m around the object at which the engine's contact begins
) -> GelSpring:
    """Compute the spring of a gel in a contact; one that does not touch is drawn in and has none.

    In the contact an elastic gel has its force and stiffness, this at most `MAX_STIFFNESS`, and a plate as heavy as `STEADY` steps ask. A
    gel whose file states no modulus presses as a Winkler foundation (pressure = modulus * indentation / thickness). Where the plate's
    distance from there to the gel's surface is below `OVERLAP` it presses less: its stiffness would have no bound.
    Friction about the normal is that of a disc of the contact's area under constant pressure, 2/3 μ times its radius.
    """
    if contact is None:
        return GelSpring()
    top = gel_top(sensor)
    height = min(max(contact.nearest - margin + OVERLAP, 0.0), top)
    modulus = GEL_MODULUS if sensor.gel is None else sensor.gel.modulus
    stiffness = modulus / sensor.layer_thickness * contact.volume / max(top - height, OVERLAP)
    torsion = 2 / 3 * friction * float(np.sqrt(contact.area / np.pi))
    mass, travel, free = GEL_MASS, 0.0, None
    if contact.force > 0:
        stiffness, travel = min(contact.stiffness, MAX_STIFFNESS), top - height + OVERLAP  # engines push the plate out of the object
        mass = max(GEL_MASS, stiffness * STEADY / STEPS_PER_SECOND**2)
        free = max(travel - 2 * contact.force / stiffness, -travel)  # a gel that presses harder for its stiffness is softened
    return GelSpring(height, stiffness, 2 * DAMPING * float(np.sqrt(stiffness * mass)), torsion, mass, travel, free)


class HoldTest(HandPhysics):
    """A hand that is fixed in the world, and an object that is free; it collides as it is, concave.

    Each gel is a plate on a spring, which touches the object at its nearest point in the tactile image. A gel without contact is drawn in
    and locked; rigid links are as in the grasp. Motors hold the posture with at most the hand's torque.
    """

    sample_interval = 5 / STEPS_PER_SECOND
    """s between two samples of the object's pose."""

    def __init__(
        self,
        hand: Hand,
        sensors: Sequence[Sensor],  # of its mounts
        *,
        mass: float,  # of the object, kg
        torsion: float | None = None,  # m, as of a `GelSpring`, of every link and gel; None: by the contact's area of gels, 0 of links
    ) -> None:
        self.mass, self.torsion = mass, torsion
        self._start: tuple[list[float], list[float]]
        self._faces: BoxedFaces
        self._springs: list[GelSpring]
        self._weight: list[float]  # N
        super().__init__(hand, sensors)

    def load(
        self,
        mesh: Mesh,
        points: Array,  # (N, 3) of its exterior, m, over which its mass is spread evenly
    ) -> None:
        """Replace everything by the hand and an object."""
        client = self.client
        client.resetSimulation()
        self._faces = box_faces(mesh.triangles)
        base_shape, *link_shapes = client.create_shapes(mesh)
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
        self._body = HandBody(client, self.hand, self._urdf)
        for link in () if self.torsion is None else self._body.links:
            client.changeDynamics(self._body.body, link, spinningFriction=self.torsion)
        self._gels = [self._body.numbers[gel_name(number)] for number in range(len(self.sensors))]
        for gel in self._gels:
            for collider in (*self._body.links, *self._gels):
                client.setCollisionFilterPair(self._body.body, self._body.body, gel, collider, 0)

    def hold(
        self,
        grasp: Grasp,  # of the object that is loaded
        *,
        acceleration: Sequence[float] = DOWN,  # (3,) world, m/s², see `_accelerate`
        seconds: float = 1.0,  # at most: the test ends early when the object rests
        limit: float = WITHIN,  # m that the object's centre may move; beyond, the test ends early
        path: Sequence[Array] = (),  # (J,) targets of the motors, each for `path_seconds`, without gravity
        path_seconds: float = 0.0,
    ) -> Motion:
        """Free the object in a grasp, whose motors drive to the squeeze, and record how it moves.

        With a path, the fingers begin at the pre-grasp, else in the grasp. PyBullet remembers contacts: the grasps that were tested since
        `load` change where an object ends by less than a millimetre, seldom by more.
        """
        penetration = self._begin(grasp, closes=len(path) > 0)
        track = Track(self._object_pose(), limit=limit, interval=self.sample_interval)
        self._accelerate((0.0, 0.0, 0.0))
        for posture in path:
            self._drive(posture)
            self.advance(path_seconds)
        self._accelerate(acceleration)
        self._drive(grasp.squeeze_angles)
        for _ in range(round(seconds / self.sample_interval)):
            self.advance(self.sample_interval)
            if track.ends(self._object_pose()):
                break
        return track.motion(penetration)

    def _begin(self, grasp: Grasp, *, closes: bool) -> float:
        """Set hand, gels and object to the start of a test; return the penetration of the hand into the object, m."""
        client, hand, start = self.client, self._body, grasp.pregrasp_angles if closes else grasp.joint_angles
        hand.set_pose(grasp.hand_pose, start, start)
        self._springs = [self._press(number, contact, out=closes) for number, contact in enumerate(self._with_forces(grasp))]
        client.resetBasePositionAndOrientation(self._object, *self._start)
        client.resetBaseVelocity(self._object, [0.0] * 3, [0.0] * 3)
        client.performCollisionDetection()
        return max(-min((point[8] for point in client.getContactPoints(self._object, hand.body)), default=0.0), 0.0)

    def _with_forces(self, grasp: Grasp) -> Iterator[Contact | None]:
        """Add their forces to the contacts of elastic gels."""
        for number, (contact, sensor) in enumerate(zip(grasp.contacts, self.sensors, strict=True)):
            if contact is not None and sensor.gel is not None:
                contact = with_force(contact, self._faces, grasp.sensor_pose[number], sensor)
            yield contact

    def _accelerate(self, acceleration: Sequence[float]) -> None:
        """Set the acceleration (3,), m/s², where gels are elastic of the object alone: plates and links are too heavy then."""
        self._weight = [self.mass * component for component in acceleration]
        self.client.setGravity(*((0.0, 0.0, 0.0) if self.elastic else acceleration))

    def _drive(self, posture: Array) -> None:
        self._body.drive(posture)

    def advance(self, seconds: float) -> None:
        """Advance the simulation, with the gels' springs."""
        body, gels, tops = self._body.body, self._gels, [gel_top(sensor) for sensor in self.sensors]
        states, control, step = self.client.getJointStates, self.client.setJointMotorControlArray, self.client.stepSimulation
        for _ in range(round(seconds * STEPS_PER_SECOND)):
            forces = [
                spring.force(top - height) - spring.damping * speed
                for spring, top, (height, speed, *_) in zip(self._springs, tops, states(body, gels), strict=True)
            ]
            control(body, gels, pybullet.TORQUE_CONTROL, forces=forces)
            if self.elastic:
                centre = self.client.getBasePositionAndOrientation(self._object)[0]
                self.client.applyExternalForce(self._object, -1, self._weight, centre, pybullet.WORLD_FRAME)
            step()

    def forces(self) -> Array:  # (S + 1, 3) N, world
        """Read the forces on the object in the last step: of each gel, then of all rigid links together."""
        forces, numbers = np.zeros((len(self._gels) + 1, 3)), {gel: number for number, gel in enumerate(self._gels)}
        for point in self.client.getContactPoints(self._body.body, self._object):
            normal, size, along, first, across, second = point[7], point[9], point[11], point[10], point[13], point[12]
            force = size * np.array(normal) + first * np.array(along) + second * np.array(across)
            forces[numbers.get(point[3], -1)] -= force
        return forces

    def _object_pose(self) -> Array:
        """Read the centre, m, and quaternion of the object, (7,); NaN after a numerical failure of an engine."""
        return np.concatenate(self.client.getBasePositionAndOrientation(self._object))

    def _press(self, number: int, contact: Contact | None, *, out: bool) -> GelSpring:
        """Move a gel to its contact, or with `out` to its surface; return its spring."""
        sensor, gel = self.sensors[number], self._gels[number]
        spring = gel_spring(sensor, contact, friction=self.hand.friction, margin=COLLISION_MARGIN)
        twist = spring.torsion if self.torsion is None else self.torsion
        self.client.resetJointState(self._body.body, gel, gel_top(sensor) if out and contact else spring.height)
        if self.elastic:
            self.client.changeDynamics(self._body.body, gel, mass=spring.mass)
        lock = 0.0 if contact else LOCK_FORCE
        self.client.setJointMotorControl2(self._body.body, gel, pybullet.POSITION_CONTROL, targetPosition=0.0, force=lock)
        self.client.changeDynamics(self._body.body, gel, lateralFriction=self.hand.friction, spinningFriction=twist)
        return spring

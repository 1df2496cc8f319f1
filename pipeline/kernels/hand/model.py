"""The model of a hand: links and joints, and which of them are fingers with a sensor."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array, Indices
from pipeline.kernels.geometry.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Shape:
    """A visual or collision shape of a link."""

    kind: str  # "box", "sphere", "cylinder", "capsule" or "mesh"
    size: tuple[float, ...]  # (x, y, z), (radius,), (radius, length along z; a capsule's without ends), m; scale of a mesh file
    origin: Array  # (4, 4) frame of the shape in its link's frame
    mesh: Mesh  # the shape in its link's frame, m, with its colour
    path: Path | None = None  # mesh file, None for other kinds
    beside: tuple[Path, ...] = ()  # files that it names: materials and textures
    rpy: tuple[float, ...] | None = None  # rad, the turn of `origin` as the URDF states it: physics engines make their own matrix of it


@dataclass(frozen=True, eq=False)
class Inertial:
    """The mass of a link and its moments of inertia."""

    mass: float  # kg
    centre: Array  # (3,) in the link's frame, m
    rpy: tuple[float, ...]  # rad, turn of the frame of the moments
    moments: tuple[float, ...] | None  # xx, xy, xz, yy, yz, zz, kg m²; None where none are stated


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part of a hand: its name, shapes and mass."""

    name: str
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]
    inertial: Inertial | None = None  # None where no mass is stated


@dataclass(frozen=True)
class Mimic:
    """Coupling of a joint to another joint: its value is `multiplier` times that joint's, plus `offset`."""

    joint: str
    multiplier: float
    offset: float  # rad, of a prismatic joint m


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint from one link to another."""

    name: str
    kind: str
    parent: int  # number of the link
    child: int
    origin: Array  # (4, 4) the child's frame in the parent's at rest
    axis: Array  # (3,) unit vector in the child's frame
    lower: float  # rad, of a prismatic joint m; as the file states it, also of a continuous joint
    upper: float
    mimic: Mimic | None = None  # names the joint that it follows
    rpy: tuple[float, ...] | None = None  # rad, as of a `Shape`; None where the joint is frozen
    damping: float = 0.0  # N m s/rad, of a prismatic joint N s/m
    friction: float = 0.0  # N m, of a prismatic joint N

    @property
    def limits(self) -> tuple[float, float]:
        """Its range, rad (m): a full turn of a continuous joint."""
        return (-np.pi, np.pi) if self.kind == "continuous" else (self.lower, self.upper)


class HandModel(NamedTuple):
    """What a URDF or an MJCF describes."""

    links: tuple[Link, ...]  # the root first, parents before children
    joints: tuple[Joint, ...]  # joint i moves link i + 1
    files: tuple[Path, ...] = ()  # that an MJCF names: includes, meshes, textures; a URDF's are those of its shapes
    notes: tuple[str, ...] = ()  # what is ignored, or taken otherwise than the file says
    torque: float | None = None  # N m (N), the least limit of its actuators
    allowed_contacts: frozenset[tuple[int, int]] = frozenset()  # links that an MJCF excludes from contact, the lower number first


@dataclass(frozen=True)
class Follower:
    """A moving link whose joint follows entry `entry` of the joint vector: its value is `multiplier` times that entry, plus `offset`."""

    link: int
    entry: int
    multiplier: float
    offset: float

    def of(self, joint_vector: Array) -> Array:  # (…) rad (m), of postures (…, J)
        """Compute the value of its joint."""
        return self.multiplier * joint_vector[..., self.entry] + self.offset


@dataclass(frozen=True, eq=False)
class Mount:
    """A sensor on a link. Its frame is at the centre of the sensor plane, +z outward, +x along image columns, +y along image rows."""

    name: str  # as the hand file calls it: by default, as the finger that it is on
    link: int  # number of the link that carries it
    pose: Array  # (4, 4) sensor frame in the link's frame
    sensor: str  # name of an included sensor, or absolute path of a sensor file


@dataclass(frozen=True, eq=False)
class Finger:
    """Links that move independently of the rest of the hand: a finger, or several that share a motor."""

    name: str  # as the hand file calls it; of several fingers their names, joined by +
    joints: tuple[int, ...]  # its entries of the joint vector
    links: tuple[int, ...]  # links that it moves, base to tip
    sensors: tuple[int, ...]  # numbers of the sensors that it carries; there may be none


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand of L links, J joints that move, F fingers and S sensors.

    Links and joints are the model's tree: the root link first, parents before children, fixed joints included. The joint vector goes finger
    by finger. Fingers and sensors are in the hand file's order: sensors finger by finger, those on the palm last.
    """

    name: str  # of the hand file
    path: Path  # of the hand file
    model: Path  # URDF or MJCF
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    joint_links: tuple[int, ...]  # (J,) link that each entry of the joint vector moves, by `joints[link - 1]`
    joint_names: tuple[str, ...]  # (J,)
    lower: Array  # (J,) limits, rad (m for a prismatic joint)
    upper: Array  # (J,)
    fingers: tuple[Finger, ...]
    sensors: tuple[Mount, ...]
    palm_facing: Array  # (3,) unit outward normal of the palm, in the root link's frame
    palm_centre: Array  # (3,) point of its face that is set over the object, in the root link's frame, m
    followers: tuple[Follower, ...] = ()  # links whose joints mimic another one and have no entry in the joint vector
    frozen: Mapping[str, float] = field(default_factory=dict)  # rad (m), of joints that no finger uses: fixed ones
    allowed_contacts: frozenset[tuple[int, int]] = frozenset()  # links that may overlap, the lower number first
    torque: float = 0.7  # N m (N for a prismatic joint), of every joint's motor
    friction: float = 0.5  # coefficient of the links' surfaces
    model_files: tuple[Path, ...] = ()  # that an MJCF names

    @property
    def link_fingers(self) -> Indices:
        """(L,) number of the finger that moves each link, -1 for none."""
        fingers = np.full(len(self.links), -1)
        for number, finger in enumerate(self.fingers):
            fingers[list(finger.links)] = number
        return fingers

    @property
    def sensor_fingers(self) -> Indices:
        """(S,) number of the finger that carries each sensor, -1 for the palm."""
        return self.link_fingers[[mount.link for mount in self.sensors]]

    @property
    def torque_unit(self) -> str:
        """The unit of `torque`: that of joints that turn, that of joints that slide, or both."""
        slides = {self.joints[link - 1].kind == "prismatic" for link in self.joint_links}
        return "N m (N where joints slide)" if len(slides) == 2 else "N" if True in slides else "N m"

    def joint_values(self, joint_vector: Array) -> dict[str, float]:  # (J,) rad (m)
        """Compute the values of all joints in a posture, rad (m), by name: those that follow others, and frozen ones, too."""
        values = dict(zip(self.joint_names, joint_vector.tolist(), strict=True))
        values |= {self.joints[follower.link - 1].name: float(follower.of(joint_vector)) for follower in self.followers}
        return {**self.frozen, **values}

    def follower_range(self, follower: Follower) -> tuple[float, float]:
        """Compute the least and the greatest value of a following joint between its leader's limits, rad (m)."""
        ends = float(follower.of(self.lower)), float(follower.of(self.upper))
        return min(ends), max(ends)

    @property
    def files(self) -> list[Path]:
        """The files that describe this hand: hand file, URDF or MJCF, what that includes, meshes with their materials and textures."""
        shapes = [shape for link in self.links for shape in (*link.visuals, *link.collisions)]
        meshes = {path for shape in shapes for path in (shape.path, *shape.beside) if path is not None}
        return [self.path, self.model, *sorted({*meshes, *self.model_files})]

    @property
    def visual_meshes(self) -> list[tuple[int, Mesh]]:
        """Meshes of the hand's appearance: (number of a link, mesh in that link's frame); gels included."""
        return [(number, shape.mesh) for number, link in enumerate(self.links) for shape in link.visuals]

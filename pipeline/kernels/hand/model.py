"""The model of a hand: links and joints, and which of them are fingers with a sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Shape:
    """A visual or collision shape of a link.

    Attributes
    ----------
    kind, size
        "box" and its (x, y, z), "sphere" and its (radius,), "cylinder" and its (radius, length along z), "capsule" and the (radius,
        length) of its cylinder, in m; or "mesh" and the (x, y, z) scale of its file.
    origin
        (4, 4) frame of the shape in its link's frame.
    mesh
        The shape in its link's frame, m, with its colour.
    path
        The mesh file, None for other kinds.
    beside
        The files that it names: materials and textures.
    """

    kind: str
    size: tuple[float, ...]
    origin: NDArray[np.float64]
    mesh: Mesh
    path: Path | None = None
    beside: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part of a hand: its name and shapes."""

    name: str
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]


@dataclass(frozen=True)
class Mimic:
    """Coupling of a joint to another joint: its value is `multiplier` times that joint's, plus `offset` (rad, of a prismatic joint m)."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint from link number `parent` to link number `child`.

    `origin` (4, 4) is the child's frame in the parent's at rest, `axis` a unit vector in the child's frame; limits in rad, of a
    prismatic joint in m; `mimic` names the joint that it follows.
    """

    name: str
    kind: str
    parent: int
    child: int
    origin: NDArray[np.float64]
    axis: NDArray[np.float64]
    lower: float
    upper: float
    mimic: Mimic | None = None


@dataclass(frozen=True)
class Follower:
    """A moving link whose joint follows entry `entry` of the joint vector: its value is `multiplier` times that entry, plus `offset`."""

    link: int
    entry: int
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class Mount:
    """A sensor on a link.

    Attributes
    ----------
    name
        As the hand file calls it: by default, as the finger that it is on.
    link
        Number of the link that carries it.
    pose
        (4, 4) sensor frame in the link's frame: origin at the centre of the sensor plane, +z outward, +x along image columns, +y along
        image rows.
    sensor
        The sensor that is mounted: name of a shipped sensor, or absolute path of a sensor file.
    """

    name: str
    link: int
    pose: NDArray[np.float64]
    sensor: str


@dataclass(frozen=True, eq=False)
class Finger:
    """Links that move independently of the rest of the hand: a finger, or several that share a motor.

    Attributes
    ----------
    name
        As the hand file calls it; of several fingers their names, joined by +.
    joints
        Its entries of the joint vector.
    links
        The links that it moves, base to tip.
    sensors
        The numbers of the sensors that it carries; there may be none.
    """

    name: str
    joints: tuple[int, ...]
    links: tuple[int, ...]
    sensors: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand of L links, J joints that move, F fingers and S sensors.

    Attributes
    ----------
    name, path
        Of the hand file.
    urdf
        The URDF file.
    links, joints
        The URDF tree: the root link first, parents before children. Fixed joints are among `joints`.
    joint_links
        (J,) link that each entry of the joint vector moves: entry j is `joints[joint_links[j] - 1]`.
    joint_names, lower, upper
        Of the J entries of the joint vector, finger by finger; limits in rad (m for a prismatic joint).
    followers
        Links whose joints mimic another joint and have no entry in the joint vector.
    frozen
        Angles, rad (m), of moving joints that no finger uses, by name; they are fixed joints in `joints`.
    allowed_contacts
        Pairs of links, the lower number first, that may overlap: those that the hand file allows, and neighbours that
        overlap at rest.
    torque, friction
        Of every joint's motor, N m (N for a prismatic joint), and of the links' surfaces.
    fingers, sensors
        In the hand file's order: sensors finger by finger, those on the palm last.
    palm_facing, palm_centre
        (3,) unit outward normal of the palm, and the point of its face that is set over the object, in the root link's frame.
    """

    name: str
    path: Path
    urdf: Path
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    joint_links: tuple[int, ...]
    joint_names: tuple[str, ...]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    fingers: tuple[Finger, ...]
    sensors: tuple[Mount, ...]
    palm_facing: NDArray[np.float64]
    palm_centre: NDArray[np.float64]
    followers: tuple[Follower, ...] = ()
    frozen: Mapping[str, float] = field(default_factory=dict)
    allowed_contacts: frozenset[tuple[int, int]] = frozenset()
    torque: float = 0.7
    friction: float = 0.5

    @property
    def link_fingers(self) -> NDArray[np.intp]:
        """(L,) number of the finger that moves each link, -1 for none."""
        fingers = np.full(len(self.links), -1)
        for number, finger in enumerate(self.fingers):
            fingers[list(finger.links)] = number
        return fingers

    @property
    def sensor_fingers(self) -> NDArray[np.intp]:
        """(S,) number of the finger that carries each sensor, -1 for the palm."""
        return self.link_fingers[[mount.link for mount in self.sensors]]

    @property
    def files(self) -> list[Path]:
        """The files that describe this hand: hand file, URDF, meshes with their materials and textures."""
        shapes = [shape for link in self.links for shape in (*link.visuals, *link.collisions)]
        meshes = {path for shape in shapes for path in (shape.path, *shape.beside) if path is not None}
        return [self.path, self.urdf, *sorted(meshes)]

    @property
    def visual_meshes(self) -> list[tuple[int, Mesh]]:
        """Meshes of the hand's appearance: (number of a link, mesh in that link's frame); gels included."""
        return [(number, shape.mesh) for number, link in enumerate(self.links) for shape in link.visuals]

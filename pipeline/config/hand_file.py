"""Hand files: the YAML descriptions of robot hands."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pipeline.config.description_file import description_path, read_description, shipped_files
from pipeline.config.hand_joints import JointRoles, joint_roles, moved_links
from pipeline.config.urdf import read_urdf
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.convex_parts import split_link
from pipeline.kernels.hand.model import Finger, Hand
from pipeline.kernels.hand.resting_contacts import overlapping_neighbours

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Value = TypeVar("Value")


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class _SensorMount(_Entry):
    link: str
    origin: Vector
    normal: Vector
    columns: Vector
    file: str | None = None


class _FingerEntry(_Entry):
    name: str
    joints: list[str] = Field(min_length=1)
    sensor: _SensorMount


class _PalmEntry(_Entry):
    link: str
    facing: Vector
    centre: Vector


class _HandFile(_Entry):
    name: str
    urdf: str
    sensor: str | None = None
    palm: _PalmEntry
    fingers: list[_FingerEntry] = Field(min_length=1)
    frozen: dict[str, Coordinate] = {}
    allowed_contacts: list[tuple[str, str]] = []
    convex_parts: dict[str, Annotated[int, Field(ge=1, le=32)]] = {}
    torque: float = Field(0.7, gt=0, le=1e6)
    friction: float = Field(0.5, ge=0, le=100)


def load_hand(name: str | Path) -> Hand:
    """Read a hand with its URDF and meshes.

    Parameters
    ----------
    name
        Name of a shipped hand (`allegro_right`), or the path of a hand file.

    Raises
    ------
    InvalidInput
        A file is missing or malformed, or the hand file names what its URDF does not have; the message names file and entry.
    """
    path = description_path("hand", name).resolve()
    file = read_description("hand", path, _HandFile)
    urdf = path.parent / os.path.expanduser(file.urdf)
    if not os.path.isfile(urdf):
        raise InvalidInput(f"{path}: there is no urdf {file.urdf!r} ({urdf}); give a path relative to the hand file, or an absolute one")
    try:
        return _without_resting_contacts(_assemble(file, path, urdf), file.allowed_contacts)
    except InvalidInput as error:
        raise InvalidInput(f"hand file {path} with {urdf.name}: {error}") from error


def _assemble(file: _HandFile, path: Path, urdf: Path) -> Hand:
    links, joints = read_urdf(urdf, file.palm.link)
    roles = joint_roles(joints, [joint for finger in file.fingers for joint in finger.joints], file.frozen)
    numbers = {link.name: i for i, link in enumerate(links)}
    for name, count in file.convex_parts.items():
        number = _find("link", name, numbers)
        links = (*links[:number], split_link(links[number], count), *links[number + 1 :])
    return Hand(
        name=file.name,
        path=path,
        urdf=urdf,
        links=links,
        joints=roles.joints,
        joint_links=tuple(joint.child for joint in roles.independent),
        joint_names=tuple(joint.name for joint in roles.independent),
        lower=np.array([joint.lower for joint in roles.independent]),
        upper=np.array([joint.upper for joint in roles.independent]),
        fingers=tuple(_finger(entry, roles, numbers, _worn(entry, file, path)) for entry in file.fingers),
        palm_facing=_unit(file.palm.facing, "palm: facing"),
        palm_centre=np.array(file.palm.centre, np.float64),
        followers=roles.followers,
        frozen=roles.frozen,
        torque=file.torque,
        friction=file.friction,
    )


def _without_resting_contacts(hand: Hand, stated: Iterable[tuple[str, str]]) -> Hand:
    """Allow the contacts that the hand file states, and those of neighbours that overlap at rest."""
    numbers = {link.name: i for i, link in enumerate(hand.links)}
    pairs = [(_find("link", one, numbers), _find("link", other, numbers)) for one, other in stated]
    named = frozenset((min(pair), max(pair)) for pair in pairs)
    return replace(hand, allowed_contacts=overlapping_neighbours(hand, collision_boxes(hand)) | named)


def _finger(entry: _FingerEntry, roles: JointRoles, link_numbers: Mapping[str, int], sensor: str) -> Finger:
    tip = _find("sensor link", entry.sensor.link, link_numbers)
    names = [joint.name for joint in roles.independent]
    own = tuple(names.index(joint) for joint in entry.joints if joint in names)
    followers = [roles.joints[one.link - 1].name for one in roles.followers if one.entry in own]
    moved = moved_links(roles.joints, [*entry.joints, *followers])
    if tip not in moved:
        raise InvalidInput(f"sensor link {entry.sensor.link!r} is not moved by the joints of finger {entry.name!r}")
    return Finger(entry.name, own, tuple(moved), tip, _sensor_pose(entry), sensor)


def _worn(entry: _FingerEntry, file: _HandFile, path: Path) -> str:
    """The sensor of a finger, else that of the hand: a shipped one's name, or a path relative to the hand file."""
    name = entry.sensor.file or file.sensor
    if name is None:
        raise InvalidInput(f"finger {entry.name!r} wears no sensor; name one in its sensor.file, or for all fingers in the hand's sensor")
    return name if name in shipped_files("sensor") else str(path.parent / os.path.expanduser(name))


def _sensor_pose(entry: _FingerEntry) -> NDArray[np.float64]:
    z, x = _unit(entry.sensor.normal, f"{entry.name}: normal"), _unit(entry.sensor.columns, f"{entry.name}: columns")
    if abs(x @ z) > 1e-6:  # a typing slip, not a rounding: the two are written by hand
        raise InvalidInput(f"{entry.name}: normal {entry.sensor.normal} and columns {entry.sensor.columns} are not perpendicular")
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    pose[:3, 3] = entry.sensor.origin
    return pose


def _find(kind: str, name: str, known: Mapping[str, Value]) -> Value:
    if name not in known:
        raise InvalidInput(f"there is no {kind} {name!r}; there are {', '.join(sorted(known))}")
    return known[name]


def _unit(vector: Vector, what: str) -> NDArray[np.float64]:
    size = float(length(vector))
    if size == 0:
        raise InvalidInput(f"{what} is the zero vector; give a direction")
    return np.array(vector, np.float64) / size

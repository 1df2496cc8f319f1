"""Hand files: the YAML descriptions of robot hands."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pipeline.config.description_file import description_path, read_description
from pipeline.config.urdf import MOVING, read_urdf
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.model import Finger, Hand, Joint

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
    sensor: str
    palm: _PalmEntry
    fingers: list[_FingerEntry] = Field(min_length=1)


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
    links, joints = read_urdf(urdf)
    try:
        names = [joint for finger in file.fingers for joint in finger.joints]
        moving = {joint.name: joint for joint in joints if joint.kind in MOVING}
        chosen = [_find("moving joint", joint, moving) for joint in names]
        if wrong := sorted(joint for joint in moving if names.count(joint) != 1):
            raise InvalidInput(f"every moving joint must belong to one finger, but not so {', '.join(wrong)}")
        numbers = {link.name: i for i, link in enumerate(links)}
        if _find("palm link", file.palm.link, numbers) != 0:
            raise InvalidInput(f"palm link {file.palm.link!r} is not the root, which is {links[0].name!r}")
        return Hand(
            name=file.name,
            path=path,
            urdf=urdf,
            sensor=file.sensor,
            links=links,
            joints=joints,
            joint_links=tuple(joint.child for joint in chosen),
            joint_names=tuple(names),
            lower=np.array([joint.lower for joint in chosen]),
            upper=np.array([joint.upper for joint in chosen]),
            fingers=tuple(_finger(entry, names, numbers, joints) for entry in file.fingers),
            palm_facing=_unit(file.palm.facing, "palm: facing"),
            palm_centre=np.array(file.palm.centre, np.float64),
        )
    except InvalidInput as error:
        raise InvalidInput(f"hand file {path} with {urdf.name}: {error}") from error


def _finger(entry: _FingerEntry, joint_names: list[str], link_numbers: Mapping[str, int], joints: Iterable[Joint]) -> Finger:
    tip = _find("sensor link", entry.sensor.link, link_numbers)
    moved: set[int] = set()
    for joint in joints:  # parents first
        if joint.name in entry.joints or joint.parent in moved:
            moved.add(joint.child)
    if tip not in moved:
        raise InvalidInput(f"sensor link {entry.sensor.link!r} is not moved by the joints of finger {entry.name!r}")
    own = tuple(joint_names.index(joint) for joint in entry.joints)
    return Finger(entry.name, own, tuple(sorted(moved)), tip, _sensor_pose(entry))


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

"""A hand: its URDF's links and joints, and what the hand file says they are for."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.kernels.hand.urdf import MOVING, Joint, Link, parse_urdf

Vector = tuple[float, float, float]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class _SensorMount(_Part):
    link: str
    origin: Vector
    normal: Vector
    columns: Vector


class _FingerEntry(_Part):
    name: str
    joints: list[str] = Field(min_length=1)
    sensor: _SensorMount


class _PalmEntry(_Part):
    link: str
    facing: Vector
    centre: Vector


class _HandFile(_Part):
    name: str
    urdf: str
    sensor: str
    palm: _PalmEntry
    fingers: list[_FingerEntry] = Field(min_length=1)


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger: `joints` are entries of the joint vector, `links` the links it moves, base to tip.

    `sensor_pose` (4, 4) is the sensor's frame in the frame of link `tip`: origin at the centre of the sensor plane (the gel's base),
    +z outward, +x along image columns, +y along image rows.
    """

    name: str
    joints: tuple[int, ...]
    links: tuple[int, ...]
    tip: int
    sensor_pose: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand of L links, J joints that move and S fingers, each with one sensor.

    Attributes
    ----------
    name, path
        Of the hand file.
    urdf
        The URDF file.
    sensor
        Name or path of the sensor file that every finger wears.
    links, joints
        The URDF tree, the root link first, parents before children; fixed joints are among `joints`.
    joint_links
        (J,) link that each entry of the joint vector moves: entry j is `joints[joint_links[j] - 1]`.
    joint_names, lower, upper
        Of the J entries of the joint vector, finger by finger; limits in rad (m for a prismatic joint).
    fingers
        In sensor order.
    palm_facing, palm_centre
        (3,) unit outward normal of the palm and the point of its face that is set over the object, in the root link's frame.
    """

    name: str
    path: Path
    urdf: Path
    sensor: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    joint_links: tuple[int, ...]
    joint_names: tuple[str, ...]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    fingers: tuple[Finger, ...]
    palm_facing: NDArray[np.float64]
    palm_centre: NDArray[np.float64]

    @property
    def files(self) -> list[Path]:
        """The files this hand is made of, to be hashed into a key: hand file, URDF, meshes."""
        meshes = {s.path for link in self.links for s in (*link.visuals, *link.collisions) if s.path is not None}
        return [self.path, self.urdf, *sorted(meshes)]


def load_hand(name: str | Path) -> Hand:
    """The hand called `name` among the project's own (`allegro_right`), or described by the hand file at that path.

    Raises `ValueError`, naming file, entry and way out, when the hand file is malformed or names what its URDF does not have.
    """
    path = _find(name)
    try:
        entries: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
        file = _HandFile.model_validate(entries)
    except (yaml.YAMLError, ValidationError) as error:
        raise ValueError(f"{path}: not a hand file: {error}\nsee pipeline/assets/hands/allegro_right.yaml for one") from error
    urdf = path.parent / Path(file.urdf).expanduser()
    if not urdf.is_file():
        raise ValueError(f"{path}: urdf {file.urdf!r} is not there ({urdf}); give a path relative to the hand file, or an absolute one")
    links, joints = parse_urdf(urdf)
    link_numbers = {link.name: i for i, link in enumerate(links)}
    moving = {joint.name: joint for joint in joints if joint.kind in MOVING}

    def find(kind: str, wanted: str, known: dict[str, Any]) -> Any:
        if wanted not in known:
            raise ValueError(f"{path}: {kind} {wanted!r} is not in {urdf.name}, which has {', '.join(sorted(known))}")
        return known[wanted]

    names = [joint for finger in file.fingers for joint in finger.joints]
    chosen = [find("moving joint", joint, moving) for joint in names]
    if len(set(names)) < len(names) or len(names) < len(moving):
        wrong = sorted({n for n in names if names.count(n) > 1} or set(moving) - set(names))
        raise ValueError(f"{path}: every moving joint belongs to one finger, but not so {', '.join(wrong)}")
    if find("palm link", file.palm.link, link_numbers) != 0:
        raise ValueError(f"{path}: palm link {file.palm.link!r} is not the root of {urdf.name}, which is {links[0].name!r}")
    fingers = []
    for entry in file.fingers:
        own = tuple(names.index(joint) for joint in entry.joints)
        tip = find("sensor link", entry.sensor.link, link_numbers)
        moved = _descendants(joints, {chosen[j].child for j in own})
        if tip not in moved:
            raise ValueError(f"{path}: sensor link {entry.sensor.link!r} is not moved by the joints of finger {entry.name!r}")
        fingers.append(Finger(entry.name, own, moved, tip, _sensor_pose(entry, path)))
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
        fingers=tuple(fingers),
        palm_facing=_unit(file.palm.facing, path, "palm facing"),
        palm_centre=np.array(file.palm.centre, np.float64),
    )


def _find(name: str | Path) -> Path:
    path = Path(name).expanduser()
    if path.suffix in (".yaml", ".yml"):
        if not path.is_file():
            raise ValueError(f"hand file {path} is not there; give a path to one, or the name of one of the project's hands")
        return path.resolve()
    folder = Path(str(resources.files("pipeline") / "assets" / "hands"))
    known = {file.stem: file for file in folder.glob("*.yaml")}
    if str(name) not in known:
        raise ValueError(f"no hand is called {str(name)!r}; there are {', '.join(sorted(known))}, or give the path of a hand file (.yaml)")
    return known[str(name)]


def _descendants(joints: tuple[Joint, ...], roots: set[int]) -> tuple[int, ...]:
    """Numbers of the given links and of all that hang on them; `joints` come parents first."""
    found = set(roots)
    for joint in joints:
        if joint.parent in found:
            found.add(joint.child)
    return tuple(sorted(found))


def _sensor_pose(entry: _FingerEntry, path: Path) -> NDArray[np.float64]:
    z = _unit(entry.sensor.normal, path, f"{entry.name}: normal")
    x = _unit(entry.sensor.columns, path, f"{entry.name}: columns")
    if abs(x @ z) > 1e-6:  # a typing slip, not a rounding: the two are written by hand
        raise ValueError(f"{path}: {entry.name}: normal {entry.sensor.normal} and columns {entry.sensor.columns} are not perpendicular")
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    pose[:3, 3] = entry.sensor.origin
    return pose


def _unit(vector: Vector, path: Path, what: str) -> NDArray[np.float64]:
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise ValueError(f"{path}: {what} is the zero vector; give a direction")
    return np.array(vector, np.float64) / length

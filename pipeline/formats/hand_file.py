"""Hand files: the YAML descriptions of robot hands."""

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from pydantic import Field

from pipeline.entries import Entries
from pipeline.errors import InvalidInput, missing_name
from pipeline.formats.description_file import description_path, read_description, shipped_files
from pipeline.formats.file_content import expanded
from pipeline.formats.hand_joints import JointRoles, joint_roles, moved_links
from pipeline.formats.urdf import read_urdf
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.convex_shapes import with_convex_shapes
from pipeline.kernels.hand.model import Finger, Hand, Joint, Mount
from pipeline.kernels.hand.self_collision import overlapping_neighbours

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Label = Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,60}$")]  # a name of an array's entry, and of exported files
Value = TypeVar("Value")
MAX_SKEW = 1e-2
"""Cosine of the angle between a sensor's normal and columns from which it is no rounding: directions of three digits are read."""


class _SensorMount(Entries):
    """The mount of a sensor: fixed to the rigid surface of a link, its gel in front. All in the link's frame."""

    link: str = Field(description="Link of the URDF; one that the finger's joints move.")
    origin: Vector = Field(description="Middle of the sensor plane, the base of the gel, on the link's surface, m.")
    normal: Vector = Field(description="Out of the link, through the gel: the sensor's +z.")
    columns: Vector = Field(description="Along the columns of the image, across the normal: the sensor's +x.")
    file: str | None = Field(None, description="A shipped sensor, or a path from the hand file; by default the hand's `sensor`.")
    name: Label | None = Field(None, description="Labels its images; by default the finger's name, numbered where it has several.")


class _FingerEntry(Entries):
    """A finger: joints that move it, and its sensors. Fingers whose joints follow one motor move together."""

    name: Label = Field(description="Name of the finger in messages, and of its sensor.")
    joints: list[str] = Field(
        min_length=1, description="Joints of the URDF that move it, and no other finger; names such as 0 or yes in quotes."
    )
    sensor: _SensorMount | None = Field(None, description="Its sensor, if it has one.")
    sensors: list[_SensorMount] = Field([], description="Several, instead of `sensor`.")

    @property
    def mounts(self) -> list[_SensorMount]:
        """All sensors of the finger: a file states one, a list, or none."""
        return [*([self.sensor] if self.sensor else []), *self.sensors]


class _PalmEntry(Entries):
    """The palm; points and directions are in its link's frame."""

    link: str = Field(description="Link of the URDF that the fingers grow from; an arm or a floating base above it is ignored.")
    facing: Vector = Field(description="The palm's outward normal, towards where objects are grasped.")
    centre: Vector = Field(
        description="The point that is set 5 to 60 mm from an object, m; for a hand with long fingers, a point between them."
    )
    sensors: list[_SensorMount] = Field([], description="Sensors on links that no finger moves.")


class HandFile(Entries):
    """A robot hand: a URDF, and what it does not state. Lengths are metres."""

    name: str = Field(description="Name of the hand, recorded in grasps.")
    urdf: str = Field(description="Path of the URDF, from the hand file; xacro, MJCF and SDF are not read.")
    sensor: str | None = Field(None, description="The sensor that fingers wear: a shipped one, or a path from the hand file.")
    palm: _PalmEntry = Field(description="Where the hand is set over an object.")
    fingers: list[_FingerEntry] = Field(min_length=1, description="One or more; a moving joint is in one of them, or `frozen`.")
    frozen: dict[str, Coordinate] = Field({}, description="Angles, rad (m), of moving joints that no finger uses.")
    allowed_contacts: list[tuple[str, str]] = Field(
        [], description="Pairs of links that may overlap. Neighbours that overlap at rest need no entry."
    )
    convex_parts: dict[str, Annotated[int, Field(ge=1, le=32)]] = Field(
        {},
        description="Hollow or bent links, each of whose meshes is cut into this many slabs; other meshes become one convex hull.",
    )
    torque: float = Field(0.7, gt=0, le=1e6, description="Maximum torque of the motors, N m (N for a joint that slides).")
    friction: float = Field(
        0.5,
        ge=0,
        le=100,
        description="Friction coefficient of the hand against the object; while fingers close around the fixed object, half of it counts.",
    )


def load_hand(
    name: str | Path,  # of a shipped hand (`allegro_right`), or the path of a hand file
) -> Hand:
    """Read a hand with its URDF and meshes; heavy collision meshes become convex shapes (`with_convex_shapes`)."""
    path = description_path("hand", name).resolve()
    if path in _cached:
        digests, hand = _cached[path]
        if digests == _digests(hand):
            return hand
    hand = _read(path)
    _cached.clear()
    _cached[path] = _digests(hand), hand
    return hand


_cached: dict[Path, tuple[list[str] | None, Hand]] = {}
"""The hand that this process loaded last, with the digests of its files: a stage loads it several times, and meshes may be large."""


def _digests(hand: Hand) -> list[str] | None:
    try:
        return [hashlib.sha256(file.read_bytes()).hexdigest() for file in hand.files]
    except OSError:
        return None


def _read(path: Path) -> Hand:
    file = read_description("hand", path, HandFile)
    urdf = path.parent / expanded(file.urdf)
    if not os.path.isfile(urdf):
        raise InvalidInput(f"{path}: there is no urdf {file.urdf!r} ({urdf}); give a path relative to the hand file, or an absolute one")
    try:
        return _with_allowed_contacts(_assemble(file, path, urdf), file.allowed_contacts)
    except InvalidInput as error:
        raise InvalidInput(f"hand file {path} with {urdf.name}: {error}") from error


def _assemble(file: HandFile, path: Path, urdf: Path) -> Hand:
    links, joints = read_urdf(urdf, file.palm.link)
    _check_entries(file, {link.name: i for i, link in enumerate(links)}, joints, path)
    roles = joint_roles(joints, [joint for finger in file.fingers for joint in finger.joints], file.frozen)
    numbers = {link.name: i for i, link in enumerate(links)}
    fingers, sensors = _fingers(file, roles, numbers, path)
    return Hand(
        name=file.name,
        path=path,
        urdf=urdf,
        links=tuple(with_convex_shapes(link, file.convex_parts.get(link.name)) for link in links),
        joints=roles.joints,
        joint_links=tuple(joint.child for joint in roles.independent),
        joint_names=tuple(joint.name for joint in roles.independent),
        lower=np.array([joint.limits[0] for joint in roles.independent]),
        upper=np.array([joint.limits[1] for joint in roles.independent]),
        fingers=fingers,
        sensors=sensors,
        palm_facing=_unit(file.palm.facing, "palm: facing"),
        palm_centre=np.array(file.palm.centre, np.float64),
        followers=roles.followers,
        frozen=roles.frozen,
        torque=file.torque,
        friction=file.friction,
    )


def _check_entries(file: HandFile, numbers: Mapping[str, int], joints: Sequence[Joint], path: Path) -> None:
    """Check every entry by itself, so that all faults are reported together."""
    names = [*file.convex_parts, *(link for pair in file.allowed_contacts for link in pair)]
    finger_mounts = [(entry.name, entry.mounts) for entry in file.fingers]
    checks: list[Callable[[], object]] = [
        lambda: joint_roles(joints, [joint for finger in file.fingers for joint in finger.joints], file.frozen),
        lambda: _unit(file.palm.facing, "palm: facing"),
        *(partial(_find, "link", name, numbers) for name in names),
        *(
            partial(_mounts, owner, [mount], numbers, file, path)
            for owner, mounts in (*finger_mounts, ("palm", file.palm.sensors))
            for mount in mounts
        ),
    ]
    faults = []
    for check in checks:
        try:
            check()
        except InvalidInput as error:
            faults.append(str(error))
    if faults:
        raise InvalidInput("; ".join(faults))


def _with_allowed_contacts(hand: Hand, stated_pairs: Iterable[tuple[str, str]]) -> Hand:
    """Set the allowed contacts: those that the hand file states, and those of neighbours that overlap at rest."""
    numbers = {link.name: i for i, link in enumerate(hand.links)}
    pairs = [(_find("link", one, numbers), _find("link", other, numbers)) for one, other in stated_pairs]
    allowed = frozenset((min(pair), max(pair)) for pair in pairs)
    return replace(hand, allowed_contacts=overlapping_neighbours(hand, collision_boxes(hand)) | allowed)


def _fingers(file: HandFile, roles: JointRoles, numbers: Mapping[str, int], path: Path) -> tuple[tuple[Finger, ...], tuple[Mount, ...]]:
    """Assemble the fingers, those that share a motor as one, and the sensors: finger by finger, those on the palm last."""
    names = [joint.name for joint in roles.independent]
    entry_of = {joint: names.index(joint) for joint in names}
    entry_of |= {roles.joints[follower.link - 1].name: follower.entry for follower in roles.followers}
    fingers, mounts = list[Finger](), list[Mount]()
    for entries in _with_shared_motors(file.fingers, entry_of):
        joints = sorted({entry_of[joint] for entry in entries for joint in entry.joints})
        moved = moved_links(roles.joints, [name for name, entry in entry_of.items() if entry in joints])
        for other in fingers:
            if both := set(other.links) & set(moved):
                link = next(name for name, number in numbers.items() if number in both)
                raise InvalidInput(
                    f"fingers {other.name!r} and {entries[0].name!r} both move link {link!r}, but fingers move by themselves; "
                    "freeze the joint that moves both, or make them one finger"
                )
        first_mount = len(mounts)
        for entry in entries:
            for mount in _mounts(entry.name, entry.mounts, numbers, file, path):
                if mount.link not in moved:
                    link = next(name for name, number in numbers.items() if number == mount.link)
                    raise InvalidInput(f"sensor link {link!r} is not moved by the joints of finger {entry.name!r}")
                mounts.append(mount)
        name = "+".join(entry.name for entry in entries)
        fingers.append(Finger(name, tuple(joints), tuple(moved), tuple(range(first_mount, len(mounts)))))
    for mount in _mounts("palm", file.palm.sensors, numbers, file, path):
        if mover := next((finger.name for finger in fingers if mount.link in finger.links), None):
            raise InvalidInput(f"palm: finger {mover!r} moves the link of sensor {mount.name!r}; list the sensor under that finger")
        mounts.append(mount)
    if not mounts:
        raise InvalidInput("no finger has a sensor, nor has the palm; give one a sensor")
    if twice := [mount.name for mount in mounts if [other.name for other in mounts].count(mount.name) > 1]:
        raise InvalidInput(f"two sensors are called {twice[0]}; give each a name")
    return tuple(fingers), tuple(mounts)


def _with_shared_motors(entries: Sequence[_FingerEntry], entry_of: Mapping[str, int]) -> list[list[_FingerEntry]]:
    """Group the fingers that share a motor, given by the entry of the joint vector that moves each joint."""
    groups: list[list[_FingerEntry]] = []
    for entry in entries:
        motors = {entry_of[joint] for joint in entry.joints}
        sharing = [group for group in groups if motors & {entry_of[joint] for member in group for joint in member.joints}]
        if sharing:
            first, *others = sharing
            first.extend([*(member for other in others for member in other), entry])
            groups = [group for group in groups if group not in others]
        else:
            groups.append([entry])
    return groups


def _mounts(owner: str, entries: Sequence[_SensorMount], numbers: Mapping[str, int], file: HandFile, path: Path) -> list[Mount]:
    mounts = []
    for number, entry in enumerate(entries):
        name = entry.name or (owner if len(entries) == 1 else f"{owner}-{number + 1}")
        sensor = entry.file or file.sensor
        if sensor is None:
            raise InvalidInput(f"sensor {name!r} has no sensor file; name one as its `file`, or for all sensors as the hand's `sensor`")
        if sensor not in shipped_files("sensor"):
            sensor = str(path.parent / expanded(sensor))
        mounts.append(Mount(name, _find("sensor link", entry.link, numbers), _sensor_pose(name, entry), sensor))
    return mounts


def _sensor_pose(name: str, entry: _SensorMount) -> Array:
    z, x = _unit(entry.normal, f"{name}: normal"), _unit(entry.columns, f"{name}: columns")
    if abs(x @ z) > MAX_SKEW:
        angle = np.degrees(np.arccos(x @ z))
        raise InvalidInput(f"{name}: normal {entry.normal} and columns {entry.columns} are {angle:.1f}° apart; make it 90°")
    x = x - (x @ z) * z  # they were rounded
    x /= length(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    pose[:3, 3] = entry.origin
    return pose


def _find(kind: str, name: str, values: Mapping[str, Value]) -> Value:
    if name not in values:
        raise InvalidInput(missing_name(kind, name, values))
    return values[name]


def _unit(vector: Vector, what: str) -> Array:
    size = float(length(vector))
    if size == 0:
        raise InvalidInput(f"{what} is the zero vector; give a direction")
    return np.array(vector, np.float64) / size

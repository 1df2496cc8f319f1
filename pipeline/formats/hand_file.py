"""Hand files: the YAML descriptions of robot hands."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.util import cache_from_source, find_spec
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from pydantic import AfterValidator, AliasChoices, Field, model_validator

from pipeline.entries import Entries
from pipeline.errors import InvalidInput, missing_name
from pipeline.formats.description_file import description_path, read_description, shipped_files
from pipeline.formats.file_cache import FileCache, Stamps, stamps_of
from pipeline.formats.file_content import expanded
from pipeline.formats.hand_joints import JointRoles, joint_roles, moved_links
from pipeline.formats.mesh_reader import read_within_limits
from pipeline.formats.mjcf_files import is_mjcf
from pipeline.formats.urdf import read_urdf
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import pose_of, unit_vectors
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.convex_shapes import with_convex_shapes
from pipeline.kernels.hand.model import Finger, Hand, HandModel, Mount
from pipeline.kernels.hand.self_collision import overlapping_neighbours

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Direction = Annotated[Vector, AfterValidator(lambda vector: _not_zero(vector))]
Label = Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,60}$")]  # a name of an array's entry, and of exported files
TORQUE = 0.7  # N m (N), of motors by default, unless an MJCF states less
KEPT = Path(cache_from_source(__file__)).with_name("hands.pickle")
CODE = sorted(file for part in ("formats/*.py", "kernels/**/*.py", "rng.py") for file in Path(__file__).parents[1].glob(part))
CODE += [Path(spec.origin) for spec in map(find_spec, ("numpy", "scipy", "trimesh", "mujoco")) if spec and spec.origin]
"""Files that what is kept of hands depends on: modules, and what an upgrade of a library writes."""
WRITTEN_BY = stamps_of(CODE)
MAX_SKEW = 1e-2  # cosine of the angle between normal and columns from which it is no rounding: directions have three digits


class _SensorMount(Entries):
    """The mount of a sensor: fixed to the rigid surface of a link, its gel in front. All in the link's frame."""

    link: str = Field(description="Link of the model; one that the finger's joints move.")
    origin: Vector = Field(description="Middle of the sensor plane, the base of the gel, on the link's surface, m.")
    normal: Direction = Field(description="Out of the link, through the gel: the sensor's +z.")
    columns: Direction = Field(description="Along the columns of the image, across the normal: the sensor's +x.")
    file: str | None = Field(None, description="A shipped sensor, or a path from the hand file; by default the hand's `sensor`.")
    name: Label | None = Field(None, description="Labels its images; by default the finger's name, numbered where it has several.")

    @model_validator(mode="after")
    def _is_perpendicular(self) -> "_SensorMount":
        skew = float(unit_vectors(self.columns) @ unit_vectors(self.normal))
        if abs(skew) > MAX_SKEW:
            raise ValueError(f"normal {self.normal} and columns {self.columns} are {np.degrees(np.arccos(skew)):.1f}° apart; make it 90°")
        return self

    @property
    def pose(self) -> Array:
        """The sensor's frame (4, 4) in the link's."""
        z, x = unit_vectors(self.normal), unit_vectors(self.columns)
        x = unit_vectors(x - (x @ z) * z)  # they were rounded
        return pose_of(np.column_stack([x, np.cross(z, x), z]), self.origin)


class _FingerEntry(Entries):
    """A finger: joints that move it, and its sensors. Fingers whose joints follow one motor move together."""

    name: Label = Field(description="Name of the finger in messages, and of its sensor.")
    joints: list[str] = Field(min_length=1, description="Joints that move it, and no other finger; names such as 0 or yes in quotes.")
    sensor: _SensorMount | None = Field(None, description="Its sensor, if it has one.")
    sensors: list[_SensorMount] = Field([], description="Several, instead of `sensor`.")

    @property
    def mounts(self) -> list[_SensorMount]:
        """All sensors of the finger: a file states one, a list, or none."""
        return [*([self.sensor] if self.sensor else []), *self.sensors]


class _PalmEntry(Entries):
    """The palm; points and directions are in its link's frame."""

    link: str = Field(description="Link of the model that the fingers grow from; an arm or a floating base above it is ignored.")
    facing: Direction = Field(description="The palm's outward normal, towards where objects are grasped.")
    centre: Vector = Field(description="The point that is set 5 to 60 mm from an object, m; with long fingers, a point between them.")
    sensors: list[_SensorMount] = Field([], description="Sensors on links that no finger moves.")


class HandFile(Entries):
    """A robot hand: a URDF or an MJCF, and what it does not state. Lengths are metres."""

    name: str = Field(description="Name of the hand, recorded in grasps.")
    model: str = Field(
        validation_alias=AliasChoices("model", "urdf"),
        description="Path of a URDF or MJCF, from the hand file; xacro and SDF are not read. `urdf` is its older name.",
    )
    sensor: str | None = Field(None, description="The sensor that fingers wear: a shipped one, or a path from the hand file.")
    palm: _PalmEntry = Field(description="Where the hand is set over an object.")
    fingers: list[_FingerEntry] = Field(min_length=1, description="One or more; a moving joint is in one of them, or `frozen`.")
    frozen: dict[str, Coordinate] = Field({}, description="Angles, rad (m), of moving joints that no finger uses.")
    allowed_contacts: list[tuple[str, str]] = Field(
        [], description="Pairs of links that may overlap. Neighbours that overlap at rest, and pairs that an MJCF excludes, need no entry."
    )
    convex_parts: dict[str, Annotated[int, Field(ge=1, le=32)]] = Field(
        {}, description="Hollow or bent links, each of whose meshes is cut into this many slabs; other meshes become one convex hull."
    )
    torque: float | None = Field(
        None,
        gt=0,
        le=1e6,
        description=f"Maximum torque of the motors, N m (N for a joint that slides); by default {TORQUE}, or less if an MJCF's are weaker. "
        "Fingers close on elastic gels until these ask it of one motor.",
    )
    friction: float = Field(0.5, ge=0, le=100, description="Friction coefficient of hand and object; half of it while fingers close.")

    @property
    def mounts(self) -> Iterator[tuple[_FingerEntry | None, str, _SensorMount]]:
        """The sensors, finger by finger, then those on the palm, with their fingers and names."""
        owners = [(entry, entry.name, entry.mounts) for entry in self.fingers]
        for entry, owner, mounts in (*owners, (None, "palm", self.palm.sensors)):
            for number, mount in enumerate(mounts, 1):
                yield entry, mount.name or (owner if len(mounts) == 1 else f"{owner}-{number}"), mount

    @model_validator(mode="before")
    @classmethod
    def _model_is_named_once(cls, content: Any) -> Any:
        if isinstance(content, dict) and {"model", "urdf"} <= content.keys():
            raise ValueError("`urdf` is the older name of `model`: keep one of the two")
        return content

    @model_validator(mode="after")
    def _sensors_are_named(self) -> "HandFile":
        names = [name for _, name, _ in self.mounts]
        if not names:
            raise ValueError("no finger has a sensor, nor has the palm; give one a sensor")
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"two sensors are called {twice[0]}; give each a name")
        if lost := [name for _, name, mount in self.mounts if not (mount.file or self.sensor)]:
            raise ValueError(f"sensor {lost[0]!r} has no sensor file; name one as its `file`, or for all sensors as the hand's `sensor`")
        return self


def _not_zero(vector: Vector) -> Vector:
    if not any(vector):
        raise ValueError("it is the zero vector; give a direction")
    return vector


def load_hand(
    name: str | Path,  # of a shipped hand (`allegro_right`), or the path of a hand file
) -> Hand:
    """Read a hand, or find it as kept between runs; heavy collision meshes become convex shapes (`with_convex_shapes`)."""
    path = description_path("hand", name).resolve()
    if path in _cached:
        stamps, hand = _cached[path]
        if stamps and stamps == stamps_of(hand.files):
            return hand
    kept = FileCache(KEPT, WRITTEN_BY, limit=10)
    hand = kept.find(str(path))
    if hand is None:
        hand = _read(path)
        keep_with_hand(kept, str(path), hand, hand)
    _cached.clear()
    _cached[path] = stamps_of(hand.files, kept.opened), hand
    return hand


def keep_with_hand(cache: FileCache, name: str, value: object, hand: Hand, files: Iterable[Path] = ()) -> None:
    """Keep a value until anything is written beside the files of a hand, or these; not where a mesh names a file that may appear."""
    if not any(shape.mesh.unread for link in hand.links for shape in (*link.visuals, *link.collisions)):
        cache.keep(name, value, {place for file in (*hand.files, *files) for place in (file, file.parent)})
        cache.save()


_cached: dict[Path, tuple[Stamps | None, Hand]] = {}
"""The hand that this process loaded last, with the stamps of its files: a stage loads it several times, and meshes may be large."""


def _read(path: Path) -> Hand:
    file = read_description("hand", path, HandFile)
    model = path.parent / expanded(file.model)
    if not os.path.isfile(model):
        raise InvalidInput(f"{path}: there is no model {file.model!r} ({model}); give a path relative to the hand file, or an absolute one")
    try:
        return _assemble(file, path, model)
    except InvalidInput as error:
        raise InvalidInput(f"hand file {path} with {model.name}: {error}") from error


def read_model(path: Path, root: str) -> HandModel:
    """Read a URDF or an MJCF, its link `root` and those below it alone."""
    if is_mjcf(path):
        return cast(HandModel, read_within_limits("mjcf", path, root))
    return HandModel(*read_urdf(path, root))


def _assemble(file: HandFile, path: Path, model: Path) -> Hand:
    described = read_model(model, file.palm.link)
    links, joints = described.links, described.joints
    numbers = {link.name: number for number, link in enumerate(links)}
    named = [("link", name) for name in (*file.convex_parts, *chain(*file.allowed_contacts))]
    named += [("sensor link", mount.link) for _, _, mount in file.mounts]
    faults = [missing_name(kind, name, numbers) for kind, name in named if name not in numbers]
    try:
        roles = joint_roles(joints, [joint for finger in file.fingers for joint in finger.joints], file.frozen)
    except InvalidInput as error:
        raise InvalidInput("; ".join([str(error), *faults])) from error  # all faults together
    if faults:
        raise InvalidInput("; ".join(faults))
    fingers, sensors = _fingers(file, roles, numbers, path)
    hand = Hand(
        name=file.name,
        path=path,
        model=model,
        links=tuple(with_convex_shapes(link, file.convex_parts.get(link.name)) for link in links),
        joints=roles.joints,
        joint_links=tuple(joint.child for joint in roles.independent),
        joint_names=tuple(joint.name for joint in roles.independent),
        lower=np.array([joint.limits[0] for joint in roles.independent]),
        upper=np.array([joint.limits[1] for joint in roles.independent]),
        fingers=fingers,
        sensors=sensors,
        palm_facing=unit_vectors(file.palm.facing),
        palm_centre=np.array(file.palm.centre, np.float64),
        followers=roles.followers,
        frozen=roles.frozen,
        torque=file.torque or min(TORQUE, described.torque or TORQUE),
        friction=file.friction,
        model_files=described.files,
    )
    pairs = [sorted((numbers[one], numbers[other])) for one, other in file.allowed_contacts]
    stated = frozenset((first, second) for first, second in pairs)
    return replace(hand, allowed_contacts=overlapping_neighbours(hand, collision_boxes(hand)) | described.allowed_contacts | stated)


def _fingers(file: HandFile, roles: JointRoles, numbers: Mapping[str, int], path: Path) -> tuple[tuple[Finger, ...], tuple[Mount, ...]]:
    """Assemble the fingers, those that share a motor as one, and the sensors: finger by finger, those on the palm last."""
    motor_of = {joint.name: number for number, joint in enumerate(roles.independent)}
    motor_of |= {roles.joints[follower.link - 1].name: follower.entry for follower in roles.followers}
    shipped = shipped_files("sensor")

    def mounts_of(owner: _FingerEntry | None) -> list[Mount]:
        sensors = [(name, mount, mount.file or file.sensor or "") for entry, name, mount in file.mounts if entry is owner]
        return [
            Mount(name, numbers[mount.link], mount.pose, sensor if sensor in shipped else str(path.parent / expanded(sensor)))
            for name, mount, sensor in sensors
        ]

    link_names, fingers, mounts = list(numbers), list[Finger](), list[Mount]()
    for entries in _with_shared_motors(file.fingers, motor_of):
        motors = sorted({motor_of[joint] for entry in entries for joint in entry.joints})
        moved = moved_links(roles.joints, [name for name, motor in motor_of.items() if motor in motors])
        for other in fingers:
            if both := set(other.links) & set(moved):
                raise InvalidInput(
                    f"fingers {other.name!r} and {entries[0].name!r} both move link {link_names[min(both)]!r}, but fingers move by "
                    "themselves; freeze the joint that moves both, or make them one finger"
                )
        first_mount = len(mounts)
        for entry in entries:
            mounts += mounts_of(entry)
            if still := [link_names[mount.link] for mount in mounts[first_mount:] if mount.link not in moved]:
                raise InvalidInput(f"sensor link {still[0]!r} is not moved by the joints of finger {entry.name!r}")
        name = "+".join(entry.name for entry in entries)
        fingers.append(Finger(name, tuple(motors), tuple(moved), tuple(range(first_mount, len(mounts)))))
    for mount in mounts_of(None):
        if mover := next((finger.name for finger in fingers if mount.link in finger.links), None):
            raise InvalidInput(f"palm: finger {mover!r} moves the link of sensor {mount.name!r}; list the sensor under that finger")
        mounts.append(mount)
    return tuple(fingers), tuple(mounts)


def _with_shared_motors(entries: Sequence[_FingerEntry], motor_of: Mapping[str, int]) -> list[list[_FingerEntry]]:
    """Group the fingers that share a motor."""
    groups: list[list[_FingerEntry]] = []
    for entry in entries:
        motors = {motor_of[joint] for joint in entry.joints}
        sharing = [group for group in groups if motors & {motor_of[joint] for member in group for joint in member.joints}]
        groups = [group for group in groups if group not in sharing[1:]]
        if sharing:
            sharing[0].extend([*(member for group in sharing[1:] for member in group), entry])
        else:
            groups.append([entry])
    return groups

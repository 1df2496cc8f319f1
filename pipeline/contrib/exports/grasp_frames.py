"""Read a dataset as frames, here one per grasp, with the type, unit and meaning of each column, for every table format."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from typing import Any, Literal

import numpy as np

from pipeline.config.manifest import SPLITS
from pipeline.console import pluralise, with_progress
from pipeline.dataset.grasps import grasp_counts
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StoreError
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.directory import Collection, DataDirectory
from pipeline.store.storage import Location
from schemas.base import Array
from schemas.catalogue import artifact_of
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from schemas.vision import VISION

Kind = Literal["string", "int64", "bool", "float32", "float64", "image"]


@dataclass(frozen=True)
class Column:
    """A column of all frames."""

    kind: Kind
    shape: tuple[int, ...] = ()  # of one value; () of a scalar
    names: tuple[str, ...] = ()  # of the entries along its first axis
    unit: str = "1"
    meaning: str = ""


BY_FINGER = ("tactile_image", "depth", "pressure", "force")  # arrays with a column per finger; only an elastic gel has the last two


class Frames:
    """The frames of a dataset's usable objects, in episodes; values are as stored, to the bit."""

    by_finger: Sequence[str]  # arrays with a column per finger
    hand: str  # its name, or the sensor's where there is no hand
    summary: str  # of what is exported
    task: str  # what is done to the object
    fps: float = 1.0  # frames per second: grasps are not a film; each follows one second after the last

    def __init__(
        self,
        data: Location,
        arrays: Mapping[str, str],  # as they are stored, by the names of their columns
        main: Collection,
    ) -> None:
        self.arrays, self._main = arrays, main
        self.rows = ObjectRows(data, list(arrays.values()), split=None)
        splits = {name: main.row(name).split for name in self.rows.object_ids}
        # by split, in order, without empty splits
        self.object_ids = {split: names for split in SPLITS if (names := [name for name, of in splits.items() if of == split])}
        if not self.object_ids:
            raise StoreError(f"{data.resolve()} has no object in the splits {', '.join(SPLITS)}")
        self.labels: dict[str, tuple[str, ...]] = {}
        identifiers = {name: artifact_of(name).arrays[name] for name in ("object_id", "category", "split")}
        self.columns = {name: Column("string", unit=array.units, meaning=array.description) for name, array in identifiers.items()}

    def episodes(self) -> Iterator[tuple[str, list[dict[str, Any]]]]:
        """Yield the split and the frames of each episode, split by split, and show the progress.

        A frame has values by column: images are (rows, cols, 3) uint8, scalars are Python's.
        """
        categories = dict(zip(self.rows.object_ids, self.rows.categories, strict=True))
        for split, object_id in with_progress([(split, name) for split, names in self.object_ids.items() for name in names], "export"):
            identity = {"object_id": object_id, "category": categories[object_id], "split": split}
            for frames in self._frames_of(object_id):
                yield split, [identity | frame for frame in frames]

    def instruction(self, category: str) -> str:
        """Write the task with an object of a category."""
        return f"{self.task} {'an' if category[:1].lower() in 'aeiou' else 'a'} {category}"

    def declaration(self, name: str) -> Array:
        """Find the declaration of an array."""
        return artifact_of(self.arrays[name]).arrays[self.arrays[name]]

    def _frames_of(self, object_id: str) -> Iterator[list[dict[str, Any]]]:
        """Yield the frames of each episode of an object, without its names."""
        raise NotImplementedError

    def _read_hand(self, grasps: Collection) -> dict[str, int]:
        """Read the names of hand, sensors and joints; return the number of grasps by object."""
        self.hand = str(grasps.first.attributes.get("hand", {}).get("name", "unknown"))
        self.labels = {dim: tuple(str(name) for name in grasps.first.read(dim)) for dim in ("sensor", "joint")}
        return grasp_counts(grasps, self.rows.object_ids)

    def _name_sensors(self, sensors: Iterable[Sensor]) -> dict[str, str]:
        """Add the columns with the names of the sensors; return their values."""
        named = [Column("string", meaning=f"Name of the sensor on {finger}.") for finger in self.labels["sensor"]]
        self.columns |= self._by_finger("sensor", named)
        return self._by_finger("sensor", [sensor.name for sensor in sensors])

    def _describe(self, name: str, skipped: Sequence[str]) -> dict[str, Column]:
        """Describe the columns of an array by its schema; a frame has one entry along the skipped dimensions."""
        array, by_finger = self.declaration(name), name in self.by_finger
        dims = [dim for dim in array.dims if dim not in (*skipped, *(("sensor",) if by_finger else ()))]
        kind: Any = "image" if dims[-1:] == ["rgb"] else array.dtype
        shape = tuple(self.rows.size(self.arrays[name], dim) for dim in dims)
        column = Column(kind, shape, self.labels.get(dims[0], ()) if dims else (), array.units, array.description)
        if not by_finger:
            return {name: column}
        return self._by_finger(
            name, (replace(column, meaning=f"{column.meaning} Of the sensor on {finger}.") for finger in self.labels["sensor"])
        )

    def _values(self, name: str, value: np.ndarray) -> dict[str, Any]:
        """Name the values of an array's columns."""
        values = self._by_finger(name, value) if name in self.by_finger else {name: value}
        return {column: one if self.columns[column].shape else one.item() for column, one in values.items()}

    def _by_finger(self, name: str, values: Iterable[Any]) -> dict[str, Any]:
        return {f"{name}.{finger}": value for finger, value in zip(self.labels["sensor"], values, strict=True)}


class GraspFrames(Frames):
    """The grasps of a dataset's usable objects as frames, an episode per object."""

    by_finger = BY_FINGER
    task = "grasp"

    def __init__(self, data: Location) -> None:
        directory = DataDirectory(data)
        grasps, touch, vision = (directory.collection(artifact) for artifact in (GRASPS, TOUCH, VISION))
        optional = {"held": grasps, **dict.fromkeys(BY_FINGER, touch), "unoccluded": vision, "occluded": vision}
        stored = [name for name, collection in optional.items() if collection.shards and collection.first.has(name)]
        arrays = ("touch_success", "joint_angles", "hand_pose", "sensor_pose", *stored)
        super().__init__(data, dict(zip(arrays, arrays, strict=True)), grasps)
        self.grasps = self._read_hand(grasps)
        self.summary = pluralise(sum(self.grasps.values()), "grasp")
        self.columns["grasp"] = Column("int64", meaning="Number of the grasp, 0 the best.")
        self.columns["hand"] = Column("string", meaning="Name of the hand.")
        self._names = {"hand": self.hand}  # the same in all frames
        if touch.shards:
            self._names |= self._name_sensors(self.rows.sensors())
        for name in self.arrays:
            self.columns |= self._describe(name, ("object", "grasp", "camera"))

    def _frames_of(self, object_id: str) -> Iterator[list[dict[str, Any]]]:
        frames = []
        for grasp in range(self.grasps[object_id]):
            values = [self._values(name, self.rows.read(name, object_id, grasp, camera=0)) for name in self.arrays]
            frames.append({"grasp": grasp, **self._names} | {name: value for part in values for name, value in part.items()})
        yield frames


def distinct_names(names: Iterable[str], written: Callable[[str], str]) -> dict[str, str]:
    """Write names in the characters that a format allows; those that become equal are numbered."""
    result: dict[str, str] = {}
    for name in dict.fromkeys(names):
        numbered = chain([written(name)], (f"{written(name)}_{number}" for number in count(2)))
        result[name] = next(other for other in numbered if other not in result.values())
    return result

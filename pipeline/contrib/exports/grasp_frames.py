"""Read a dataset as frames, one per grasp, with the type, unit and meaning of each column, for every table format."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, count
from typing import Any, Literal

from pipeline.config.manifest import SPLITS
from pipeline.console import pluralise, with_progress
from pipeline.dataset.grasps import grasp_counts
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
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


BY_FINGER = ("tactile_image", "depth", "pressure", "force")
"""Arrays with a column per finger; only an elastic gel has the last two."""


class GraspFrames:
    """The grasps of a dataset's usable objects as frames; values are as stored, to the bit."""

    def __init__(self, data: Location) -> None:
        directory = DataDirectory(data)
        grasps, touch, vision = (directory.collection(artifact) for artifact in (GRASPS, TOUCH, VISION))
        optional = {"held": grasps, **dict.fromkeys(BY_FINGER, touch), "unoccluded": vision, "occluded": vision}
        self.arrays = ["touch_success", "joint_angles", "hand_pose", "sensor_pose"]
        self.arrays += [name for name, collection in optional.items() if collection.shards and collection.first.has(name)]
        self.rows = ObjectRows(data, self.arrays, split=None)
        splits = {name: grasps.row(name).split for name in self.rows.object_ids}
        # by split, in order, without empty splits
        self.object_ids = {split: names for split in SPLITS if (names := [name for name, of in splits.items() if of == split])}
        if not self.object_ids:
            raise StoreError(f"{data.resolve()} has no object in the splits {', '.join(SPLITS)}")
        self.labels = {dim: tuple(str(name) for name in grasps.first.read(dim)) for dim in ("sensor", "joint")}
        self.grasps = grasp_counts(grasps, self.rows.object_ids)
        self.summary = pluralise(sum(self.grasps.values()), "grasp")
        identifiers = {name: artifact_of(name).arrays[name] for name in ("object_id", "category", "split")}
        self.columns = {name: Column("string", unit=array.units, meaning=array.description) for name, array in identifiers.items()}
        self.columns["grasp"] = Column("int64", meaning="Number of the grasp, 0 the best.")
        self.columns["hand"] = Column("string", meaning="Name of the hand.")
        self.hand = str(self.rows.attributes("grasps").get("hand", {}).get("name", "unknown"))
        self._names = {"hand": self.hand}  # the same in all frames
        if touch.shards:
            self._names |= self._by_finger("sensor", [sensor.name for sensor in self.rows.sensors()])
            named = [Column("string", meaning=f"Name of the sensor on {finger}.") for finger in self.labels["sensor"]]
            self.columns |= self._by_finger("sensor", named)
        for name in self.arrays:
            self.columns |= self._describe(name)

    def objects(self) -> Iterator[tuple[str, list[dict[str, Any]]]]:
        """Yield the split and the frames of each object, split by split, and show the progress.

        A frame has values by column: images are (rows, cols, 3) uint8, scalars are Python's.
        """
        categories = dict(zip(self.rows.object_ids, self.rows.categories, strict=True))
        for split, object_id in with_progress([(split, name) for split, names in self.object_ids.items() for name in names], "export"):
            frames = []
            for grasp in range(self.grasps[object_id]):
                frame = {"object_id": object_id, "category": categories[object_id], "split": split, "grasp": grasp, **self._names}
                for name in self.arrays:
                    value = self.rows.read(name, object_id, grasp, camera=0)
                    values = self._by_finger(name, value) if name in BY_FINGER else {name: value}
                    frame |= {column: one if self.columns[column].shape else one.item() for column, one in values.items()}
                frames.append(frame)
            yield split, frames

    def _describe(self, name: str) -> dict[str, Column]:
        """Describe the columns of an array by its schema."""
        array = artifact_of(name).arrays[name]
        dims = [dim for dim in array.dims if dim not in ("object", "grasp", "camera", *(("sensor",) if name in BY_FINGER else ()))]
        kind: Any = "image" if dims[-1:] == ["rgb"] else array.dtype
        shape, names = tuple(self.rows.size(name, dim) for dim in dims), self.labels.get(dims[0], ()) if dims else ()
        column = Column(kind, shape, names, array.units, array.description)
        if name not in BY_FINGER:
            return {name: column}
        return self._by_finger(
            name, (replace(column, meaning=f"{column.meaning} Of the sensor on {finger}.") for finger in self.labels["sensor"])
        )

    def _by_finger(self, name: str, values: Iterable[Any]) -> dict[str, Any]:
        return {f"{name}.{finger}": value for finger, value in zip(self.labels["sensor"], values, strict=True)}


def distinct_names(names: Iterable[str], written: Callable[[str], str]) -> dict[str, str]:
    """Write names in the characters that a format allows; those that become equal are numbered."""
    result: dict[str, str] = {}
    for name in dict.fromkeys(names):
        numbered = chain([written(name)], (f"{written(name)}_{number}" for number in count(2)))
        result[name] = next(other for other in numbered if other not in result.values())
    return result


def instruction(category: str) -> str:
    """Write the task of grasping an object of a category."""
    return f"grasp {'an' if category[:1].lower() in 'aeiou' else 'a'} {category}"

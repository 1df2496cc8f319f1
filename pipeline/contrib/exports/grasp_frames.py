"""Read a dataset as frames, one per grasp, with the type of each column, for every table format."""

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.config.manifest import SPLITS
from pipeline.console import Meter, errors, pluralise
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
    """Describe a column: its kind, the shape of one value (() of a scalar), and names of the entries along its first axis."""

    kind: Kind
    shape: tuple[int, ...] = ()
    names: tuple[str, ...] = ()


BY_FINGER = ("tactile_image", "depth")
"""Arrays with a column per finger."""


class GraspFrames:
    """The grasps of a dataset's usable objects as frames; values are as stored, to the bit."""

    def __init__(self, data: Location) -> None:
        directory = DataDirectory(data)
        touch, vision = (directory.collection(artifact) for artifact in (TOUCH, VISION))
        self.arrays = ["touch_success", "joint_angles", "hand_pose", "sensor_pose", *(BY_FINGER if touch.shards else ())]
        self.arrays += [name for name in ("unoccluded", "occluded") if vision.shards and vision.first.has(name)]
        self.rows = ObjectRows(data, self.arrays, split=None)
        grasps = directory.collection(GRASPS)
        splits = {name: grasps.row(name).split for name in self.rows.object_ids}
        # by split, in order, without empty splits
        self.object_ids = {split: names for split in SPLITS if (names := [name for name, of in splits.items() if of == split])}
        if not self.object_ids:
            raise StoreError(f"{data.resolve()} has no object in the splits {', '.join(SPLITS)}")
        self.labels = {dim: tuple(str(name) for name in grasps.first.read(dim)) for dim in ("sensor", "joint")}
        self.grasps = self.rows.size("joint_angles", "grasp")
        self._categories = dict(zip(self.rows.object_ids, self.rows.categories, strict=True))
        self.columns = {name: Column("string") for name in ("object_id", "category", "split")} | {"grasp": Column("int64")}
        for name in self.arrays:
            self.columns |= self._describe(name)

    def objects(self) -> Iterator[tuple[str, str, list[dict[str, Any]]]]:
        """Yield the split, the id and the frames of each object, split by split, and show the progress."""
        with Meter(errors, "export", sum(map(len, self.object_ids.values())), "objects") as meter:
            for split, ids in self.object_ids.items():
                for object_id in ids:
                    yield split, object_id, list(self.frames(object_id, split))
                    meter.advance()

    @property
    def summary(self) -> str:
        """The number of grasps."""
        return pluralise(self.grasps * sum(map(len, self.object_ids.values())), "grasp")

    def frames(self, object_id: str, split: str) -> Iterator[dict[str, Any]]:
        """Yield the frames of an object, values by column; images are (rows, cols, 3) uint8."""
        for grasp in range(self.grasps):
            frame: dict[str, Any] = {"object_id": object_id, "category": self._categories[object_id], "split": split, "grasp": grasp}
            for name in self.arrays:
                value = self.rows.read(name, object_id, grasp, camera=0)
                frame |= self._by_finger(name, value) if name in BY_FINGER else {name: value}
            yield frame

    def _describe(self, name: str) -> dict[str, Column]:
        """Describe the columns of an array by its schema."""
        array = artifact_of(name).arrays[name]
        dims = [dim for dim in array.dims if dim not in ("object", "grasp", "camera", *(("sensor",) if name in BY_FINGER else ()))]
        kind: Any = "image" if dims[-1] == "rgb" else array.dtype
        column = Column(kind, tuple(self.rows.size(name, dim) for dim in dims), self.labels.get(dims[0], ()))
        return self._by_finger(name, [column] * len(self.labels["sensor"])) if name in BY_FINGER else {name: column}

    def _by_finger(self, name: str, values: Iterable[Any]) -> dict[str, Any]:
        return {f"{name}.{finger}": value for finger, value in zip(self.labels["sensor"], values, strict=True)}


def png(image: NDArray[np.uint8]) -> bytes:
    """Write an image (R, C, 3) as PNG: lossless."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(buffer, "PNG")
    return buffer.getvalue()

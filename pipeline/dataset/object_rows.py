"""The arrays of a dataset's objects, read on demand, for training, evaluation, prediction and users."""

import shlex
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from pipeline.errors import StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL, bounding_diagonal
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.directory import DataDirectory
from pipeline.store.shard import Shard
from pipeline.store.storage import Location, as_location
from pipeline.store.validate import check_origins
from schemas.base import INDEXED_DIMS, Artifact
from schemas.catalogue import artifact_of
from schemas.charts import FITTED
from schemas.surfaces import SURFACES

CACHE_MEGABYTES = 256.0  # size of the cache of decoded arrays: a small dataset is read once, a large one streams through

POINTS = ("local_points", "local_count")  # arrays that need not be stored: they are computed from depth and sensor pose, equal to the bit

DIFFERENCE = "difference"  # not stored: the tactile image minus that of the untouched sensor, (grasp, sensor, row, col, rgb) int16

DERIVED = {**dict.fromkeys(POINTS, ("depth", "sensor_pose")), DIFFERENCE: ("tactile_image", "untouched")}
"""Arrays that are derived on reading, and the stored arrays that they need."""

_SENSORS = TypeAdapter(Annotated[tuple[Sensor, ...], Field(min_length=1)])


class UsableObjects:
    """The objects of a split that failed in none of the artifacts that are read, in id order."""

    _sensors: tuple[Sensor, ...] | None  # read once

    def __init__(
        self,
        data: str | Location,  # a data directory
        artifacts: Iterable[Artifact],
        split: str | None,  # train, valid or test; None for all objects
        optional: Sequence[Artifact] = (),  # read if they have been made
    ) -> None:
        self.data, self.split, self._sensors = as_location(data), split, None
        self.directory = DataDirectory(self.data)
        self.directory.check_exists()
        opened = [self.directory.collection(artifact) for artifact in artifacts]
        opened += [collection for collection in map(self.directory.collection, optional) if collection.shards]
        self.collections = {collection.artifact.name: collection for collection in opened}
        for collection in opened:
            collection.first  # noqa: B018 (an error where it has not been made)
        check_origins(self.directory, self.collections)
        first = opened[0]
        members = [*(name for name in first if split in (None, first.row(name).split)), *first.missing]
        # why an object failed in an artifact that is read, or that an incomplete one lacks it
        self.failures = {name: failure for name in members for collection in opened if (failure := collection.failure(name))}
        self.object_ids = [name for name in members if name not in self.failures]
        if not self.object_ids:
            status = f"see `vt-pipeline status {shlex.quote(str(self.data))}`"
            failed = f"; {len(self.failures)} have failed or are not made yet, {status}" if self.failures else ""
            where = "" if split is None else f" in split {split}"
            splits = ", ".join(sorted({first.row(name).split for name in first}))
            remedy = "" if split is None or failed else f", but in {splits}; the manifest's `splits` define their numbers"
            raise StoreError(f"{self.data.resolve()} has no usable object{where}{failed}{remedy}")

    def __len__(self) -> int:
        return len(self.object_ids)

    def attributes(self, artifact: str) -> Mapping[str, Any]:
        """Read the attributes of an artifact's root, such as `sensors` of `touch`."""
        return self.collections[artifact].first.attributes

    def sensors(self) -> tuple[Sensor, ...]:
        """Read the sensor of each finger."""
        if self._sensors is None:
            self._sensors = sensors_of(self.collections["touch"].first)
        return self._sensors

    def sensor(self) -> Sensor:
        """Read the sensor of all tactile images."""
        return sensor_of(self.collections["touch"].first)


class ObjectRows(UsableObjects):
    """The arrays of a split's objects that failed in none of the artifacts that are read. Memory does not grow with the dataset."""

    def __init__(
        self,
        data: str | Location,  # a data directory
        arrays: Sequence[str],  # names, or paths such as meshes/vertices; shapes, units and frames are the schemas'
        split: str | None = "train",  # train, valid or test; None for all objects
        *,
        cache_megabytes: float = CACHE_MEGABYTES,  # limit of the cache of arrays
    ) -> None:
        sources = [source for name in arrays for source in DERIVED.get(name, ())]
        try:
            self._artifact_of = {name: artifact_of(name) for name in (*arrays, *sources) if name != DIFFERENCE}
        except KeyError as error:
            raise StoreError(error.args[0]) from None
        super().__init__(data, {artifact.name: artifact for artifact in self._artifact_of.values()}.values(), split)
        for name, artifact in self._artifact_of.items():
            shard = self.collections[artifact.name].first
            if name not in DERIVED and "/" not in name and not shard.has(name):
                raise StoreError(f"{shard.path} has no array {name}; enable it in the settings of its stage and run again")
        self.arrays = tuple(arrays)
        self.failed = {name: f"{failure.stage}: {failure.reason}" for name, failure in self.failures.items()}
        first = next(iter(self.collections.values()))
        self.categories = [first.row(name).category for name in self.object_ids]
        self._cache, self._diagonals = _Cache(int(cache_megabytes * 1e6)), dict[str, float]()

    def dims(self, array: str) -> tuple[str, ...]:
        """Return the dimensions of an array, by name."""
        name = DERIVED[DIFFERENCE][0] if array == DIFFERENCE else array
        declared = self._artifact_of[name].of(name)
        return declared.dims if declared else ()

    def size(self, array: str, dim: str) -> int:
        """Return the size of an array along one of its dimensions, the same in every object."""
        position = self.dims(array).index(dim)
        return int(self.collections[self._artifact_of[array].name].first.stored(array).shape[position])

    def diagonal(self, object_id: str) -> float:
        """Compute the diagonal of an object's bounding box, m, of the mesh in `surfaces`."""
        if object_id not in self._diagonals:
            surface = self.directory.collection(SURFACES).view(object_id)
            self._diagonals[object_id] = bounding_diagonal(surface["meshes/vertices"])
        return self._diagonals[object_id]

    def read(
        self,
        array: str,
        object_id: str,
        grasp: int | None = None,  # or viewpoint; None for all
        camera: int | None = None,  # None for all
    ) -> np.ndarray:  # the remaining dimensions of the schema
        """Read an object's part of an array; the array itself if it has no object dimension.

        Arrays without grasps or cameras ignore these numbers. Other readers share the array: copy it before changing it.
        """
        if array == DIFFERENCE:
            return self._difference(object_id, grasp)
        if array not in self._artifact_of:
            raise StoreError(f"array {array} was not opened, only {', '.join(self._artifact_of)}; name it when the rows are opened")
        artifact = self._artifact_of[array]
        shard = self.collections[artifact.name].shard(object_id)
        if "/" in array:
            return self._cache.get((array, object_id), lambda: self._read_ragged(array, object_id))
        if array in DERIVED and not shard.has(array):
            return self._derive(array, object_id, grasp)
        dims = artifact.arrays[array].dims
        if dims[0] != "object":
            return self._cache.get((array,), lambda: shard.read(array))
        by_grasp = grasp is not None and len(dims) > 1 and dims[1] in INDEXED_DIMS
        part = tuple(camera if dim == "camera" and camera is not None else slice(None) for dim in dims[1:])
        stored, position = shard.stored(array), shard.position[object_id]
        entry = position if camera is None or "camera" not in dims else (position, *part)
        indices = {"camera": camera, **dict.fromkeys(INDEXED_DIMS, grasp)}
        for dim, count in zip(dims, stored.shape, strict=True):
            if (number := indices.get(dim)) is not None and not -count <= number < count:
                raise StoreError(f"{object_id} has no {dim} {number}; there are {count}, numbered from 0")
        chunks = stored.chunks
        if chunks[0] > 1:  # a chunk holds several objects
            chunk_start = position - position % chunks[0]
            rows = self._cache.get((array, shard.path, chunk_start), lambda: shard.read(array, slice(chunk_start, chunk_start + chunks[0])))
            row = rows[(position - chunk_start, *part)]  # a string becomes an array, too
        elif by_grasp and chunks[1] == 1 and grasp and (array, object_id, camera) not in self._cache:
            return self._cache.get((array, object_id, camera, grasp), lambda: shard.read(array, (position, grasp, *part[1:])))
        else:  # also for grasp 0, the first in a pass through an object: one call in place of one per grasp
            row = self._cache.get((array, object_id, camera), lambda: shard.read(array, entry))
        return np.asarray(row[grasp] if by_grasp else row)

    def _read_ragged(self, array: str, object_id: str) -> np.ndarray:
        view = self.collections[self._artifact_of[array].name].view(object_id)
        if array not in view:
            raise StoreError(f"{object_id} has no array {array}; there are {', '.join(name for name in view if '/' in name)}")
        return view[array]

    def _derive(self, array: str, object_id: str, grasp: int | None) -> np.ndarray:
        from pipeline.kernels.touch.depth_maps import local_points  # compiled: readers of other arrays need not wait

        sensors = self.sensors()
        depth, pose = (self.read(name, object_id, grasp) for name in ("depth", "sensor_pose"))
        sites = depth.shape[:-2]  # ([grasp,] sensor)
        values = [local_points(depth[site], pose[site], sensors[site[-1]])[POINTS.index(array)] for site in np.ndindex(sites)]
        return np.stack(values).reshape(*sites, *np.shape(values[0]))

    def _difference(self, object_id: str, grasp: int | None) -> np.ndarray:
        return np.asarray(self.read("tactile_image", object_id, grasp).astype(np.int16) - self.read("untouched", object_id))


class _Cache:
    """Cache arrays, up to a number of bytes; the least recently used goes first."""

    def __init__(self, limit: int) -> None:
        self._limit, self._bytes = limit, 0
        self._arrays: OrderedDict[Hashable, np.ndarray] = OrderedDict()

    def __contains__(self, key: Hashable) -> bool:
        return key in self._arrays

    def get(self, key: Hashable, read: Callable[[], np.ndarray]) -> np.ndarray:
        with suppress(KeyError):  # another thread may take it out
            self._arrays.move_to_end(key)
            return self._arrays[key]
        array = read()
        array.flags.writeable = False
        replaced = self._arrays.get(key)  # by a thread that has read the same
        self._arrays[key] = array
        self._bytes += array.nbytes - (0 if replaced is None else replaced.nbytes)
        while self._bytes > self._limit and len(self._arrays) > 1:
            self._bytes -= self._arrays.popitem(last=False)[1].nbytes
        return array


def has_paper_sizes(data: Location) -> bool:
    """Check whether every object was scaled to the paper's diagonal: only then can figures in metres be compared with the paper's."""
    shard = DataDirectory(data).collection(SURFACES).first
    if shard.attributes.get("settings", {}).get("diagonal", DIAGONAL) != DIAGONAL:
        return False
    rows = ObjectRows(data, ["metres_per_unit"], split=None)
    return all(rows.read("metres_per_unit", object_id) == 0 for object_id in rows.object_ids)


def paired_rows(first: Path, second: Path, *arrays: str) -> Iterator[tuple[str, list[np.ndarray], list[np.ndarray]]]:
    """Yield the id of each object that failed in neither of two data directories, and its named arrays from each."""
    ours, theirs = (ObjectRows(data, arrays, split=None) for data in (first, second))
    for object_id in ours.object_ids:
        if object_id not in theirs.failed:
            yield object_id, [ours.read(name, object_id) for name in arrays], [theirs.read(name, object_id) for name in arrays]


def sensors_of(shard: Shard) -> tuple[Sensor, ...]:
    """Read the sensor of each finger from a shard of `touch`, or that of `presses`; raise a `StoreError` if one is not described."""
    try:
        return _SENSORS.validate_python(shard.attributes.get("sensors"))
    except ValidationError as error:
        raise StoreError(f"{shard.path}: its sensor cannot be used ({invalid_entries(error)}); {shard.remedy}") from error


def sensor_of(shard: Shard) -> Sensor:
    """Read the sensor that all fingers wear, as `sensors_of`; raise a `StoreError` if they wear different ones."""
    first, *others = sensors_of(shard)
    if different := {sensor.name for sensor in others if sensor != first}:
        raise StoreError(
            f"{shard.path}: the fingers wear different sensors ({', '.join(sorted(different | {first.name}))}); training on touches needs "
            "a hand that wears one: see `sensor` in its hand file"
        )
    return first


def is_surface(stop_rule: np.ndarray) -> np.ndarray:  # (…) bool
    """Distinguish fitted charts from undeformed squares by their `stop_rule` (…)."""
    return np.isin(stop_rule, FITTED)

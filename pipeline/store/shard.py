"""Read a published shard, object by object."""

import hashlib
import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.errors import OtherVersion, StoreError, first_line
from pipeline.store import digest
from pipeline.store.layout import numpy_dtype, schema_name
from pipeline.store.record import RowRecord, ShardRecord, named_location
from pipeline.store.rows import Row, row_digest
from pipeline.store.storage import File, Location, exists, files_below, is_machine_fault, map_in_threads, read_bytes
from pipeline.store.stored_array import StoredArray, array_violations
from schemas.base import COMMON, Artifact

_CHUNK = re.compile(r"/c(/[0-9]+)*$")  # the end of a chunk's path, which follows that of its array


class Shard:
    """A shard, open for reading: the Zarr group that its record names."""

    def __init__(self, folder: Location, artifact: Artifact, record: ShardRecord) -> None:
        self.path = folder / record.location
        self.artifact = artifact
        self.record = record
        self.position = {row.object_id: position for position, row in enumerate(record.rows)}
        self._stored: dict[str, StoredArray] = {}
        if record.schema_version != artifact.version:
            raise OtherVersion(f"{self.path} has schema version {record.schema_version}, not {artifact.version}; run its stage again")

    def row(self, object_id: str) -> RowRecord:
        """Return the record of an object's row."""
        return self.record.rows[self.position[object_id]]

    @property
    def has_rows(self) -> bool:
        """Whether any object has a row; without one, arrays have size 0 or are missing."""
        return any(row.failure is None for row in self.record.rows)

    def has(self, name: str) -> bool:
        """Check whether the root has an array of this name: not every shard has all arrays of its schema."""
        return name in self.record.metadata

    @cached_property
    def attributes(self) -> Mapping[str, Any]:
        """The group's attributes: settings, and the descriptions of hand, sensor or scene."""
        content = self._metadata("")
        with self.errors_as_damage("its attributes cannot be used"):
            stored: Mapping[str, Any] = dict(json.loads(content)["attributes"])
            digest.of_json(stored)  # refuses what is no JSON: NaN
        return stored

    def _metadata(self, name: str) -> bytes:
        """Read a `zarr.json`; raise an error if it has changed: Zarr and readers rely on it."""
        path = self.path / name / "zarr.json"
        try:
            content = read_bytes(path)
        except OSError as error:
            raise StoreError(f"{path} cannot be read ({error.strerror or 'there is no such file'}); {self.remedy}") from error
        if "/" not in name and hashlib.sha256(content).hexdigest() != self.record.metadata.get(name):
            raise StoreError(f"{path} differs from what was written; {self.remedy}")
        return content

    @cached_property
    def _files(self) -> dict[str, File]:
        """All files of the group but hidden ones, by their path below it."""
        return {name: file for name, file in files_below(self.path).items() if not digest.is_hidden(name)}

    @cached_property
    def _chunk_files(self) -> Counter[str]:
        """The number of non-empty chunk files by array."""
        return Counter(_CHUNK.sub("", name) for name, file in self._files.items() if file.bytes)

    @cached_property
    def ragged(self) -> dict[str, list[str]]:
        """The names of the ragged arrays that each object has, as its row names them."""
        groups = {pattern.split("/")[0] for pattern in self.artifact.ragged}
        ragged: dict[str, list[str]] = defaultdict(list)
        for path in sorted(self._files) if groups else ():
            match path.split("/"):
                case group, object_id, leaf, "zarr.json" if group in groups:
                    ragged[object_id].append(f"{group}/{leaf}")
        return ragged

    @contextmanager
    def errors_as_damage(self, what: str) -> Iterator[None]:
        """Convert any error that zarr and its codecs raise on changed bytes to a `StoreError`."""
        try:
            yield
        except StoreError:
            raise
        except Exception as error:
            if is_machine_fault(error):
                raise
            raise StoreError(f"{self.path}: {what} ({first_line(error)}); {self.remedy}") from error

    @property
    def remedy(self) -> str:
        """The remedy for a shard that is damaged, or was replaced since it was opened."""
        record = self.path.with_name(f"{self.path.name.rpartition('-')[0]}.json")
        if not exists(record) or named_location(record) not in (None, self.path.name):
            return "it was replaced since it was opened: open the dataset again, or run the same command again"
        return f"`vt-pipeline run {self.record.stage} --check`, with its other options as before, makes what is damaged again"

    def described(self) -> dict[str, StoredArray]:
        """Parse the `zarr.json` of every array, of which the schema may have none."""
        names = [file.removesuffix("/zarr.json") for file in self._files if file.endswith("/zarr.json")]
        contents = zip(names, map_in_threads(read_bytes, [self.path / name / "zarr.json" for name in names]), strict=True)
        return {name: StoredArray.open(self.path / name, text) for name, text in contents if json.loads(text)["node_type"] == "array"}

    def stored(self, name: str) -> StoredArray:
        """Find a stored array, by its path below the root.

        Refused are arrays with missing or empty files, which Zarr would read as zeros, and those that differ from the
        schema or the record: a stranger's store may be sound otherwise.
        """
        if name in self._stored:
            return self._stored[name]
        self.attributes  # noqa: B018 (an error where the group's own metadata have changed)
        of_object, declared, content = "/" in name, self.artifact.of(schema_name(name)), self._metadata(name)
        with self.errors_as_damage(f"{name} cannot be opened"):
            array = StoredArray.open(self.path / name, content)
            files = math.prod(math.ceil(size / part) for size, part in zip(array.shape, array.file_shape, strict=True))
            violations = list(array_violations(name, declared, array)) if declared else []
        if (sound := self._chunk_files[name]) < files:
            raise StoreError(f"{self.path}: of {name} {files - sound} of {files} files are missing or empty; {self.remedy}")
        if declared and declared.per_object and not violations and not of_object and array.shape[0] != len(self.record.rows):
            violations = [f"{name}: it has {array.shape[0]} rows, the record {len(self.record.rows)}"]
        if violations:
            raise StoreError(f"{self.path}: {violations[0]}; {self.remedy}")
        if not of_object:
            self._stored[name] = array
        return array

    def read(self, name: str, index: Any = ...) -> np.ndarray:
        """Read an array or a part of it, by its path below the root; raise a `StoreError` if it is lost or damaged."""
        array, position = self.stored(name), index[0] if isinstance(index, tuple) and index else index
        declared = self.artifact.of(schema_name(name))
        stacked = name in self.artifact.arrays and self.artifact.arrays[name].per_object
        of_object = f" of {self.record.rows[position].object_id}" if stacked and isinstance(position, int) else ""
        with self.errors_as_damage(f"{name}{of_object} cannot be read"):
            is_whole = index is ... if not stacked else isinstance(index, int) and self.record.rows[index].failure is None
            if declared and is_whole and array.has_layout_of(declared):
                return array.read(declared, index if stacked else None)
            from pipeline.store.zarr_files import open_array

            return np.asarray(open_array(self.path, name, array.metadata)[index])

    def check_arrays(self) -> None:
        """Open every array at the root, with the errors of `stored`."""
        for name in filter(None, self.record.metadata):
            self.stored(name)

    def is_complete(self) -> bool:
        """Check that every file of every array exists and is not empty."""
        array_paths = {_CHUNK.sub("", name).removesuffix("/zarr.json") for name in self._files}
        ragged = {name for name in array_paths if name.count("/") == 2}
        try:
            self.check_arrays()
            for name in ragged:
                if not self._chunk_files[name]:  # else it is complete: a ragged array is one file, or none where its size is 0
                    self.stored(name)
        except StoreError:
            return False
        return all(file.bytes for file in self._files.values()) and all(f"{name}/zarr.json" in self._files for name in ragged)


class RowView(Mapping[str, np.ndarray]):
    """One object's row as a mapping from array names to arrays; ragged ones as `meshes/vertices`.

    Arrays are read when first used, and kept; after `verify` they are the verified ones. Constants of the shard can be
    read, and are `in` the row, but are not listed with its arrays.
    """

    def __init__(self, shard: Shard, object_id: str) -> None:
        self.shard = shard
        self.object_id = object_id
        self.record = shard.row(object_id)
        self._held: Row = {}

    @property
    def attributes(self) -> Mapping[str, Any]:
        """The attributes of the shard."""
        return self.shard.attributes

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self._held:
            return self._held[name]
        array = self.shard.artifact.of(name)
        if array is None:
            raise KeyError(f"{self.shard.artifact.name} has no array {name}")
        if "/" in name:
            group, leaf = name.split("/")
            value = self.shard.read(f"{group}/{self.object_id}/{leaf}")
        elif not array.per_object:
            value = self.shard.read(name)
        else:
            entry = self.shard.read(name, self.shard.position[self.object_id])
            value = np.array(str(entry)) if array.dtype == "string" else np.asarray(entry, numpy_dtype(array))
        self._held[name] = value
        return value

    def __contains__(self, name: object) -> bool:
        if name in self.shard.artifact.arrays:
            return self.shard.has(str(name))
        return name in self.shard.ragged.get(self.object_id, ())

    def __iter__(self) -> Iterator[str]:
        for name, array in self.shard.artifact.arrays.items():
            if array.per_object and self.shard.has(name):
                yield name
        yield from self.shard.ragged.get(self.object_id, ())

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def verify(self) -> Row:
        """Read and keep the row; raise a `StoreError` if it cannot be read, or differs from what its stage wrote."""
        self._held.clear()
        row = {} if self.record.failure else {name: self[name] for name in self if name not in COMMON}
        if row_digest(row, self.record.failure, self.record.category) != self.record.digest:
            raise StoreError(f"{self.shard.path}: {self.object_id} is damaged; {self.shard.remedy}")
        return row

"""Write and publish outputs: each version of a shard or folder has a new name, and its record then names it."""

import hashlib
import math
import shutil
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pydantic_zarr.v3 import ArraySpec, GroupSpec
from zarr.core.buffer import default_buffer_prototype
from zarr.core.group import GroupMetadata
from zarr.core.metadata.v3 import ArrayV3Metadata
from zarr.storage import LocalStore

from pipeline.errors import StoreError
from pipeline.store.atomic import move_folder, replace_version, version_of
from pipeline.store.directory import DataDirectory, changed_files, shard_name, versioned
from pipeline.store.garbage import collect, mark_replaced
from pipeline.store.layout import (
    OBJECTS_PER_FILE,
    AnyArray,
    AnyGroup,
    chunking,
    decode_array,
    encode_chunk,
    group_spec,
    numpy_dtype,
    schema_violations,
    shard_file,
)
from pipeline.store.record import FolderRecord, Provenance, RowRecord, ShardRecord, named_location, read_record, serialise_with_checksum
from pipeline.store.rows import Chunks, Result, Row, RowFiles
from pipeline.store.shard import Shard
from pipeline.store.storage import Location, files_below, remove
from pipeline.store.temporary import local_copy
from pipeline.store.validate import problems_of
from schemas.base import COMMON, FIXED, Array, Artifact

Shapes = Mapping[str, tuple[int, ...]]


def write_group(
    path: Path,  # an existing group is removed
    artifact: Artifact,
    rows: Sequence[RowRecord],  # in order
    shapes: Sequence[Shapes],  # of each row's arrays, without the object dimension
    chunks: Callable[[int], Chunks],  # reads the encoded row with this number; called once per row
    constants: Row,  # arrays without an object dimension
    attributes: Mapping[str, Any],
) -> None:
    """Write a shard's group and check its structure.

    At most `OBJECTS_PER_FILE` encoded rows are held at a time. Files without chunks are written too: one that is
    missing later was lost.
    """
    shutil.rmtree(path, ignore_errors=True)
    group_shapes = _group_shapes(artifact, rows, shapes, constants)
    _write_metadata(path, group_spec(artifact, group_shapes, attributes))
    stacked = {name: shape for name, shape in group_shapes.items() if "/" not in name and name not in (*COMMON, *constants)}
    strings: dict[str, Any] = {name: [] for name in stacked if artifact.arrays[name].dtype == "string"}
    for start in range(0, len(rows), OBJECTS_PER_FILE):
        batch = [chunks(number) for number in range(start, min(start + OBJECTS_PER_FILE, len(rows)))]
        for name, shape in stacked.items():
            parts = [encoded.get(name) for encoded in batch]
            if name in strings:
                strings[name] += ["" if part is None else str(decode_array(None, (), "U", part)) for part in parts]
            else:
                _write_file(path / name / "c" / str(start // OBJECTS_PER_FILE), artifact.arrays[name], shape, parts)
        for row, encoded in zip(rows[start:], batch, strict=False):
            for name in (name for name in encoded if "/" in name):
                _write_ragged(path.joinpath(name.split("/")[0], row.object_id, name.split("/")[1]), encoded[name], artifact.of(name))
    labels = [row.labels() for row in rows]
    common = {name: [label[name] for label in labels] for name in COMMON}
    with zarr.config.set({"array.write_empty_chunks": True}):
        group: Any = zarr.open_group(LocalStore(path), mode="r+")
        for name, values in {**constants, **strings, **common}.items():
            group[name][...] = np.array(values, numpy_dtype(artifact.arrays[name]))
    if violations := list(schema_violations(artifact, GroupSpec.from_zarr(zarr.open_group(str(path), mode="r")))):
        raise StoreError(f"{path} was written but does not fit its schema, so it is not published: {'; '.join(violations)}")


def metadata_digests(path: Path, artifact: Artifact) -> dict[str, str]:
    """Compute the SHA-256 of the `zarr.json` of a group, under the empty name, and of every array at its root that it has."""
    digests: dict[str, str] = {}
    for name in ("", *artifact.arrays):
        file = path / name / "zarr.json"
        if file.exists():
            digests[name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return digests


def _write_metadata(path: Path, spec: AnyGroup | AnyArray) -> None:
    """Write the metadata of a group and its members, as Zarr writes it."""
    path.mkdir(parents=True)
    described = ArrayV3Metadata.from_dict(spec.model_dump()) if isinstance(spec, ArraySpec) else GroupMetadata(spec.attributes)
    for name, content in described.to_buffer_dict(default_buffer_prototype()).items():
        (path / name).write_bytes(content.to_bytes())
    for name, member in spec.members.items() if isinstance(spec, GroupSpec) and spec.members else ():
        _write_metadata(path / name, member)


def _write_file(folder: Path, array: Array, shape: tuple[int, ...], parts: Sequence[list[bytes] | None]) -> None:
    """Write a file of an array from one part per object; None, for an object without a row, becomes zeros."""
    if not math.prod(shape):
        return
    file_shape, chunk = chunking(array, shape)
    if chunk[0] > 1:  # several objects share a chunk
        values = np.zeros(chunk, numpy_dtype(array))
        for number, part in enumerate(parts):
            if part is not None:
                values[number] = decode_array(array, shape[1:], array.dtype, part)
        chunks: list[bytes | None] = [encode_chunk(array, values)]
    else:
        count = math.prod(file_shape[1:]) // math.prod(chunk[1:])
        absent = [None] * count
        chunks = [encoded for part in (*parts, *[None] * (file_shape[0] - len(parts))) for encoded in part or absent]
    file = folder.joinpath(*["0"] * (len(shape) - 1))
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("wb") as opened:
        opened.writelines(shard_file(chunks))


def _write_ragged(folder: Path, chunks: list[bytes], array: Array | None) -> None:
    """Write an array of one object: its only chunk is a file, none where it is empty."""
    file = folder.joinpath("c", *["0"] * (len(array.dims) if array else 0))
    file.parent.mkdir(parents=True, exist_ok=True)
    for chunk in chunks:
        file.write_bytes(chunk)


def _refuse_partial_arrays(artifact: Artifact, rows: Sequence[RowRecord], shapes: Sequence[Shapes]) -> None:
    """Raise a `StoreError` if only some objects have an array: zeros of the others would be read as values."""
    returned = {row.object_id: names.keys() & artifact.arrays for row, names in zip(rows, shapes, strict=True) if row.failure is None}
    for name in artifact.arrays:
        having, lacking = ([object_id for object_id, names in returned.items() if (name in names) is had] for had in (True, False))
        if having and lacking:
            raise StoreError(
                f"{artifact.name}: {name}: returned for {having[0]}, not for {lacking[0]}; return it for every object, or for none"
            )


def _group_shapes(artifact: Artifact, rows: Sequence[RowRecord], shapes: Sequence[Shapes], constants: Row) -> dict[str, tuple[int, ...]]:
    """Compute the shape of every array of the shard, by path."""
    _refuse_partial_arrays(artifact, rows, shapes)
    group_shapes: dict[str, tuple[int, ...]] = dict.fromkeys(COMMON, (len(rows),))
    group_shapes |= {name: constant.shape for name, constant in constants.items()}
    for row, row_shapes in zip(rows, shapes, strict=True):
        for name, shape in row_shapes.items():
            if "/" in name:
                parent, leaf = name.split("/")
                group_shapes[f"{parent}/{row.object_id}/{leaf}"] = shape
            elif group_shapes.setdefault(name, (len(rows), *shape)) != (len(rows), *shape):
                raise StoreError(f"{artifact.name}: {name} of {row.object_id} has shape {shape}, others {group_shapes[name][1:]}")
    sizes = dict(FIXED)
    for name, shape in group_shapes.items():
        if name in artifact.arrays:
            sizes.update(zip(artifact.arrays[name].dims, shape, strict=True))
    for name, array in artifact.arrays.items():  # a shard in which every object failed still has every array
        if name not in group_shapes and not array.optional:
            group_shapes[name] = (len(rows), *(sizes.get(dim, 0) for dim in array.dims[1:]))
    return group_shapes


class Output(ABC):
    """A shard or folder that a plan makes: its paths, and its published version.

    `path` is the record's without its suffix, as messages name the output; a run holds `lock` while it makes the output. `record` is
    None if none is published, or it cannot be used.
    """

    record: Provenance | None

    def __init__(self, directory: DataDirectory, record_path: Location, work: Location, lock: str) -> None:
        self.directory, self.record_path, self.work = directory, record_path, work
        self.path, self.lock = record_path.with_suffix(""), work / lock
        self.refresh()

    @abstractmethod
    def refresh(self) -> None:
        """Read again what is published."""

    def withdraw(self) -> None:
        """Remove the record: new readers find no output, current ones get the grace period."""
        if (location := named_location(self.record_path)) is not None:
            mark_replaced(self.record_path.with_name(location))
        remove(self.record_path)

    def _publish(
        self,
        source: Path | None,  # a group or folder to move to `path`; None if it is there
        path: Location,
        record: Provenance,
        version: str | None,  # that the record had when the output was planned
        **fields: Any,  # of the record, which are known now
    ) -> None:
        """Move a group or folder to its path, then publish its record."""
        record = type(record).model_validate({**dict(record), "location": path.name, **fields})
        if source is not None:
            move_folder(source, path)
        replaced = named_location(self.record_path)
        if replaced not in (None, path.name):
            mark_replaced(path.with_name(replaced))
        if not replace_version(self.record_path, serialise_with_checksum(record), version):
            raise StoreError(f"{self.record_path} was published by another run meanwhile; run again")
        if isinstance(path, Path):  # object storage has no locks: there, `vt-pipeline collect-garbage` does it
            collect(self.directory, path.parent)
        self.refresh()


class ShardOutput(Output):
    """A shard of an artifact, and its rows that wait to be published; `shard` is None where `record` is."""

    def __init__(self, directory: DataDirectory, artifact: Artifact, number: int, shards: int) -> None:
        self.artifact, self.shards, self.name = artifact, shards, shard_name(number, shards)
        work = directory.work(artifact.name)
        self.rows = RowFiles(work, artifact)
        super().__init__(directory, directory.shard_record(artifact.name, number, shards), work, f"{self.name}.lock")

    def refresh(self) -> None:
        """Read again what is published."""
        try:
            self.shard: Shard | None = Shard(self.record_path.parent, self.artifact, read_record(self.record_path, ShardRecord))
        except StoreError:
            self.shard = None
        self.record: ShardRecord | None = None if self.shard is None else self.shard.record

    def is_complete(self) -> bool:
        """Check that every file of the published shard exists and is not empty."""
        return self.shard is not None and self.shard.is_complete()

    def is_sound(self) -> bool:
        """Check that the published shard holds what was written, by reading every value."""
        return self.shard is not None and not problems_of(self.shard)

    def commit(
        self,
        record: ShardRecord,
        results: Sequence[Result],  # of its rows, whose files are removed afterwards
        constants: Row,  # arrays without an object dimension
        attributes: Mapping[str, Any],
    ) -> None:
        """Write the group of the record's rows, and publish the record with the group's name."""
        shapes = [result.shapes for result in results]
        location = versioned(self.name, [record.key, [row.digest for row in record.rows]]) + ".zarr"
        version = version_of(self.record_path)
        with local_copy(self.work, begin=False) as work:
            for unfinished in work.glob(f"{self.name}-*.zarr"):  # of a run that was killed
                shutil.rmtree(unfinished, ignore_errors=True)
            group = work / location
            write_group(group, self.artifact, record.rows, shapes, lambda number: self.rows.chunks(results[number]), constants, attributes)
            metadata = metadata_digests(group, self.artifact)
            self._publish(group, self.path.with_name(location), record, version, metadata=metadata)
        self.rows.discard_all({result.name: result.key for result in results})


class FolderOutput(Output):
    """A folder that a dataset stage fills."""

    def __init__(self, directory: DataDirectory, name: str) -> None:
        super().__init__(directory, directory.folder_record(name), directory.work(name), "lock")

    def refresh(self) -> None:
        """Read again what is published."""
        try:
            self.record: FolderRecord | None = read_record(self.record_path, FolderRecord)
        except StoreError:
            self.record = None

    def is_complete(self) -> bool:
        """Check that every file of the published folder exists."""
        return self.record is not None and self.record.files.keys() <= files_below(self.path.with_name(self.record.location)).keys()

    def is_sound(self) -> bool:
        """Check that the published folder holds what was written, by reading every file."""
        return self.record is not None and not changed_files(self.path.with_name(self.record.location), self.record.files)

    def target(self, record: FolderRecord) -> Location:
        """Return the path of the folder that is published with a record."""
        return self.record_path.with_name(versioned(self.record_path.stem, [record.key, record.files]))

    def commit(self, filled: Path, record: FolderRecord) -> Location:
        """Move a finished folder to its versioned name, unless a killed run has; publish its record, return its path."""
        path, version = self.target(record), version_of(self.record_path)
        unmoved = filled if record.files.keys() <= files_below(filled).keys() else None
        self._publish(unmoved, path, record, version)
        return path

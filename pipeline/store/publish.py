"""Write and publish outputs: each version of a shard or folder has a new name, and its record then names it."""

import hashlib
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import StoreError
from pipeline.store.atomic import move_folder, replace_version, version_of
from pipeline.store.directory import DataDirectory, versioned
from pipeline.store.garbage import collect, mark_replaced
from pipeline.store.layout import OBJECTS_PER_FILE, array_metadata, encode_array, schema_name
from pipeline.store.record import FolderRecord, Provenance, RowRecord, ShardRecord, named_location, serialise_with_checksum
from pipeline.store.rows import Result, Row, RowFiles
from pipeline.store.storage import Location, files_below, remove
from pipeline.store.stored_array import StoredArray, encode_metadata, schema_violations, write_array, write_file, write_metadata
from pipeline.store.temporary import local_copy
from schemas.base import COMMON, FIXED, Artifact


def commit_shard(
    directory: DataDirectory,
    artifact: Artifact,
    record_path: Location,
    record: ShardRecord,  # its location and metadata are filled in
    results: Sequence[Result],  # of its rows, whose files are removed afterwards
    constants: Row,  # arrays without an object dimension
    attributes: Mapping[str, Any],  # further ones of the root
) -> None:
    """Write the group of the record's rows, and publish the record with the group's name."""
    attributes = {
        "schema": artifact.name,
        "schema_version": artifact.version,
        "stage": record.stage,
        "settings": record.settings,
        "seed": record.seed,
        "manifest": record.manifest,
        "failures": {row.object_id: row.failure.model_dump() for row in record.rows if row.failure},
        **attributes,
    }
    name, work = record_path.stem, directory.work(artifact.name)
    files = directory.rows(artifact)
    location = versioned(name, [record.key, [row.digest for row in record.rows]]) + ".zarr"
    version = version_of(record_path)
    with local_copy(work, begin=False) as local:
        for unfinished in local.glob(f"{name}-*.zarr"):  # of a run that was killed
            shutil.rmtree(unfinished, ignore_errors=True)
        metadata = write_group(local / location, artifact, record.rows, results, files, constants, attributes)
        path = record_path.with_name(location)
        _publish(directory, record_path, local / location, path, record, version, metadata=metadata)
    files.discard(results)


def commit_folder(directory: DataDirectory, name: str, filled: Path, record: FolderRecord) -> None:
    """Move a finished folder to its versioned name, unless a killed run has; publish its record."""
    record_path = directory.folder_record(name)
    path, version = folder_target(record_path, record), version_of(record_path)
    unmoved = filled if record.files.keys() <= files_below(filled).keys() else None
    _publish(directory, record_path, unmoved, path, record, version)


def folder_target(record_path: Location, record: FolderRecord) -> Location:
    """Return the path of the folder that is published with a record."""
    return record_path.with_name(versioned(record_path.stem, [record.key, record.files]))


def _publish(
    directory: DataDirectory,
    record_path: Location,
    source: Path | None,  # a group or folder to move to `path`; None if it is there
    path: Location,
    record: Provenance,
    version: str | None,  # that the record had before the group was written
    **fields: Any,  # of the record, which are known now
) -> None:
    """Move a group or folder to its path, then publish its record."""
    record = type(record).model_validate({**dict(record), "location": path.name, **fields})
    if source is not None:
        move_folder(source, path)
    replaced = named_location(record_path)
    if replaced not in (None, path.name):
        mark_replaced(path.with_name(replaced))
    if not replace_version(record_path, serialise_with_checksum(record), version):
        raise StoreError(f"{record_path} was published by another run meanwhile; run again")
    if isinstance(path, Path):  # object storage has no locks: there, `vt-pipeline collect-garbage` does it
        collect(directory, path.parent)


def withdraw(record_path: Location) -> None:
    """Remove a record: new readers find no output, current ones get the grace period."""
    if (location := named_location(record_path)) is not None:
        mark_replaced(record_path.with_name(location))
    remove(record_path)


def write_group(
    path: Path,  # an existing group is removed
    artifact: Artifact,
    rows: Sequence[RowRecord],  # in order
    results: Sequence[Result],  # of the rows
    files: RowFiles,  # of the results; each is read once
    constants: Row,  # arrays without an object dimension
    attributes: Mapping[str, Any],
) -> dict[str, str]:  # the SHA-256 of the `zarr.json` of the group, under the empty name, and of each array at its root
    """Write a shard's group, if it fits its schema.

    At most `OBJECTS_PER_FILE` encoded rows are held at a time. Files without chunks are written too: one that is
    missing later was lost.
    """
    shapes = _group_shapes(artifact, rows, results, constants)
    declared = {name: artifact.of(schema_name(name)) for name in shapes}
    if unknown := [name for name, array in declared.items() if array is None]:
        raise ValueError(f"{artifact.name} has no array {unknown[0]}; its schema names {sorted(artifact.arrays)}")
    metadata = {name: encode_metadata("array", **array_metadata(array, shapes[name])) for name, array in declared.items() if array}
    stored = {name: StoredArray.open(path / name, content) for name, content in metadata.items()}
    if violations := list(schema_violations(artifact, stored)):
        raise StoreError(f"{path} does not fit its schema, so it is not published: {'; '.join(violations)}")
    shutil.rmtree(path, ignore_errors=True)
    metadata[""] = encode_metadata("group", attributes=attributes)
    write_metadata(path, metadata)
    for name, values in constants.items():
        write_array(path / name, artifact.arrays[name], values)
    stacked = {name: shape for name, shape in shapes.items() if "/" not in name and name not in constants}
    for start in range(0, len(rows), OBJECTS_PER_FILE):
        numbers = range(start, min(start + OBJECTS_PER_FILE, len(rows)))
        batch = [{**files.chunks(results[number]), **_labels(rows[number])} for number in numbers]
        for name, shape in stacked.items():
            parts = [encoded.get(name) for encoded in batch]
            write_file(path / name / "c" / str(start // OBJECTS_PER_FILE), artifact.arrays[name], shape, parts)
        for number, encoded in zip(numbers, batch, strict=True):
            for name in (name for name in encoded if "/" in name):
                parent, leaf = name.split("/")
                ragged = f"{parent}/{rows[number].object_id}/{leaf}"
                file = path.joinpath(ragged, "c", *["0"] * len(shapes[ragged]))
                file.parent.mkdir(parents=True, exist_ok=True)
                for chunk in encoded[name]:  # one; none where the array is empty
                    file.write_bytes(chunk)
    return {name: hashlib.sha256(metadata[name]).hexdigest() for name in ("", *artifact.arrays) if name in metadata}


def _labels(row: RowRecord) -> dict[str, list[bytes]]:
    """Encode the entries of the arrays that every artifact has."""
    return {name: encode_array(COMMON[name], np.array(label)) for name, label in row.labels().items()}


def _group_shapes(artifact: Artifact, rows: Sequence[RowRecord], results: Sequence[Result], constants: Row) -> dict[str, tuple[int, ...]]:
    """Compute the shape of every array of the shard, by path; refuse arrays of some objects alone, whose zeros would be read as values."""
    returned = {row.object_id: result.arrays for row, result in zip(rows, results, strict=True)}
    made = [row.object_id for row in rows if row.failure is None]
    for name in artifact.arrays:
        having, lacking = ([object_id for object_id in made if (name in returned[object_id]) is had] for had in (True, False))
        if having and lacking:
            raise StoreError(f"{artifact.name}: {name}: returned for {having[0]}, not for {lacking[0]}; return it for all, or for none")
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(COMMON, (len(rows),))
    shapes |= {name: constant.shape for name, constant in constants.items()}
    for object_id, arrays in returned.items():
        for name, part in arrays.items():
            if "/" in name:
                parent, leaf = name.split("/")
                shapes[f"{parent}/{object_id}/{leaf}"] = part.shape
            elif shapes.setdefault(name, (len(rows), *part.shape)) != (len(rows), *part.shape):
                raise StoreError(f"{artifact.name}: {name} of {object_id} has shape {part.shape}, others {shapes[name][1:]}")
    sizes = dict(FIXED)
    for name, shape in shapes.items():
        if name in artifact.arrays:
            sizes.update(zip(artifact.arrays[name].dims, shape, strict=True))
    for name, array in artifact.arrays.items():  # a shard in which every object failed still has every array
        if name not in shapes and not array.optional:
            shapes[name] = (len(rows), *(sizes.get(dim, 0) for dim in array.dims[1:]))
    return shapes

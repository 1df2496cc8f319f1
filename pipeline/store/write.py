"""Write the Zarr group of a shard."""

import hashlib
import math
import shutil
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
from pipeline.store.encode import decode_array, encode_chunk, shard_file
from pipeline.store.record import RowRecord
from pipeline.store.row_files import Chunks
from pipeline.store.rows import Row
from pipeline.store.spec import OBJECTS_PER_FILE, AnyArray, AnyGroup, chunking, group_spec, numpy_dtype, schema_violations
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

    A `StoreError` says that two objects disagree in the shape of an array, only some have it, or the group departs from
    its schema.
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

"""Arrays in the files of a shard, checked, written and read without Zarr: for one entry it takes 2 ms, most of it in threads and tasks."""

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs import blosc
from numcodecs.vlen import VLenUTF8

from pipeline.store.layout import (
    OBJECTS_PER_FILE,
    array_codecs,
    chunking,
    decode_array,
    encode_array,
    encode_chunk,
    numpy_dtype,
    schema_name,
    with_checksum,
    without_checksum,
)
from pipeline.store.storage import Location, check_file, on_disk, read_bytes
from schemas.base import FIXED, Array, Artifact

ABSENT = (2**64 - 1, 2**64 - 1)  # offset and size of a missing chunk in the index of a file: Zarr reads the fill value

CHECKSUM = len(with_checksum(b""))


@dataclass(frozen=True)
class StoredArray:
    """An array as its `zarr.json` describes it."""

    path: Location
    shape: tuple[int, ...]
    data_type: str
    dimension_names: tuple[str, ...]
    file_shape: tuple[int, ...]  # of the part in one file
    chunks: tuple[int, ...]  # shape of the part that is encoded as a whole
    metadata: dict[str, Any]

    @classmethod
    def open(cls, path: Location, metadata: bytes) -> "StoredArray":
        """Parse the `zarr.json` of an array."""
        content = json.loads(metadata)
        names, file_shape = content.get("dimension_names"), content["chunk_grid"]["configuration"]["chunk_shape"]
        chunks = content["codecs"][0].get("configuration", {}).get("chunk_shape", file_shape)
        return cls(path, tuple(content["shape"]), content["data_type"], tuple(names or ()), tuple(file_shape), tuple(chunks), content)

    def has_layout_of(self, array: Array) -> bool:
        """Check that the array is on a disk, in files as this version lays out such an array: `read` reads no other."""
        layout = chunking(array, self.shape)[0], array_codecs(array, self.shape)
        return on_disk(self.path) is not None and (self.file_shape, self.metadata["codecs"]) == layout

    def read(self, array: Array, position: int | None = None) -> np.ndarray:
        """Read the entry of an object; without a position the array, which is one file."""
        shape = self.shape if position is None else self.shape[1:]
        if not math.prod(self.shape):
            return np.zeros(shape, numpy_dtype(array))
        number, row = divmod(position or 0, self.file_shape[0]) if self.shape else (0, 0)
        file = Path(str(self.path), "c", *[str(number), *["0"] * len(self.shape)][: len(self.shape)])
        if array.dtype == "string":
            texts = VLenUTF8().decode(blosc.decompress(without_checksum(read_bytes(file)))).astype(np.dtypes.StringDType())
            return np.asarray(texts if position is None else texts[row, ...])
        if position is None:
            return decode_array(array, shape, array.dtype, [read_bytes(file)])
        if self.chunks[0] == 1:
            return decode_array(array, shape, array.dtype, self._read_chunks(file, row))
        (encoded,) = self._read_chunks(file, 0)  # several objects share it
        return np.frombuffer(blosc.decompress(without_checksum(encoded)), numpy_dtype(array)).reshape(self.chunks)[row, ...].copy()

    def _read_chunks(self, file: Path, row: int) -> list[bytes]:
        """Read the chunks of a row from a file of `sharding_indexed`."""
        count = math.prod(self.file_shape[1:]) // math.prod(self.chunks[1:])
        size = np.dtype("<u8").itemsize * 2 * count * (self.file_shape[0] // self.chunks[0]) + CHECKSUM
        check_file(file)
        with file.open("rb") as opened:
            opened.seek(-size, os.SEEK_END)
            index = np.frombuffer(without_checksum(opened.read()), "<u8").reshape(-1, count, 2)
            return [os.pread(opened.fileno(), length, offset) for offset, length in index[row].tolist()]


def schema_violations(artifact: Artifact, arrays: Mapping[str, StoredArray]) -> Iterator[str]:
    """List the violations of a schema by a group's arrays, given by path, one line each with array and reason."""
    for name, array in artifact.arrays.items():
        if name not in arrays and not array.optional:
            yield f"{name}: the array is missing"
    sizes: dict[str, tuple[int, str]] = {}
    for path, stored in arrays.items():
        declaration = artifact.of(schema_name(path))
        if declaration is None:
            yield f"{path}: the schema has no such array"
            continue
        violations = list(array_violations(path, declaration, stored))
        yield from violations
        for dim, size in zip(declaration.dims, stored.shape, strict=True) if not violations and "/" not in path else ():
            if sizes.setdefault(dim, (size, path))[0] != size:
                yield f"{path}: dimension {dim} has size {size}, but {sizes[dim][0]} in {sizes[dim][1]}"


def array_violations(path: str, declaration: Array, stored: StoredArray) -> Iterator[str]:
    """List the violations of a declaration by a stored array, one line each."""
    if stored.data_type != declaration.dtype:
        yield f"{path}: dtype is {stored.data_type}, the schema says {declaration.dtype}"
    if stored.dimension_names != declaration.dims or len(stored.shape) != len(declaration.dims):
        yield f"{path}: dimensions are {stored.dimension_names} of {stored.shape}, the schema says {declaration.dims}"
        return
    for dim, size in zip(declaration.dims, stored.shape, strict=True):
        if size != FIXED.get(dim, size):
            yield f"{path}: dimension {dim} has size {size}, the schema says {FIXED[dim]}"


def write_file(folder: Path, array: Array, shape: tuple[int, ...], parts: Sequence[list[bytes] | None]) -> None:
    """Write a file from one part per object; the part of an object without a row is None, and read as zeros.

    It is a file of `sharding_indexed`, its chunks, then the index of all, with its checksum; or one of strings.
    """
    if not math.prod(shape):
        return
    file_shape, chunk = chunking(array, shape)
    if array.dtype == "string":
        texts = ["" if part is None else str(decode_array(None, (), "U", part)) for part in parts]
        write_constant(folder, array, np.array(texts + [""] * (file_shape[0] - len(texts)), object))
        return
    if chunk[0] > 1:  # several objects share a chunk
        values = np.zeros(chunk, numpy_dtype(array))
        for number, part in enumerate(parts):
            if part is not None:
                values[number] = decode_array(array, shape[1:], array.dtype, part)
        chunks: list[bytes | None] = [encode_chunk(array, values)]
    else:
        absent = [None] * (math.prod(file_shape[1:]) // math.prod(chunk[1:]))
        chunks = [encoded for part in (*parts, *[None] * (file_shape[0] - len(parts))) for encoded in part or absent]
    file = folder.joinpath(*["0"] * (len(shape) - 1))
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("wb") as opened:
        index = [ABSENT if encoded is None else (opened.tell(), opened.write(encoded)) for encoded in chunks]
        opened.write(with_checksum(np.array(index, "<u8").tobytes()))


def encode_metadata(kind: str, **fields: Any) -> bytes:
    """Encode the `zarr.json` of a group or an array as Zarr does."""
    last: dict[str, Any] = {"storage_transformers": []} if kind == "array" else {}
    return json.dumps({**fields, "zarr_format": 3, "node_type": kind, **last}, indent=2).encode()


def write_metadata(
    root: Path,
    metadata: Mapping[str, bytes],  # of arrays and groups, by path below the root; the groups between them are added
) -> None:
    """Write the `zarr.json` of a group and of everything in it."""
    folders = {str(parent) for name in metadata for parent in Path(name).parents[:-1]}
    for name, content in {**dict.fromkeys(folders, encode_metadata("group", attributes={})), **metadata}.items():
        (root / name).mkdir(parents=True, exist_ok=True)
        (root / name / "zarr.json").write_bytes(content)


def write_array(folder: Path, array: Array, values: np.ndarray) -> None:
    """Write the files of a whole array."""
    if not array.per_object:
        write_constant(folder.joinpath("c", *["0"] * values.ndim), array, values)
        return
    for start in range(0, len(values), OBJECTS_PER_FILE):
        parts = [encode_array(array, np.asarray(entry)) for entry in values[start : start + OBJECTS_PER_FILE]]
        write_file(folder / "c" / str(start // OBJECTS_PER_FILE), array, values.shape, parts)


def write_constant(file: Path, array: Array, values: np.ndarray) -> None:
    """Write an array, which is one chunk, to a file; an empty one has none."""
    if array.dtype == "string":
        values = np.frombuffer(VLenUTF8().encode(values.astype(object).reshape(-1)), np.uint8)
    if values.size:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(encode_chunk(array, values))

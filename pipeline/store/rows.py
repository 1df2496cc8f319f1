"""Rows, one object's part of an artifact: checks, digests, and the files in which finished rows wait for their shard."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from pydantic import Field, ValidationError

from pipeline.entries import Entries
from pipeline.errors import StoreError
from pipeline.formats.file_content import regular_stat
from pipeline.store import digest
from pipeline.store.atomic import write_atomically
from pipeline.store.layout import decode_array, encode_array, numpy_dtype, with_checksum, without_checksum
from pipeline.store.record import Failure, RowRecord
from pipeline.store.storage import Location, read_bytes, remove, remove_files
from schemas.base import COMMON, Array, Artifact

Row = dict[str, np.ndarray]  # one object's part of every array, without the object dimension; ragged ones as `meshes/vertices`


def row_digest(row: Mapping[str, np.ndarray], failure: Failure | None, category: str) -> str:
    """Compute the digest of an object's category and row, or failure."""
    return digest.of_arrays({} if failure else row, failure=failure and failure.model_dump(), category=category)


def are_valid(array: Array, values: np.ndarray) -> bool:
    """Check that floats are finite, or +inf where the declaration allows it; other values are always valid."""
    return values.dtype.kind != "f" or bool((values > -np.inf if array.infinite else np.isfinite(values)).all())


def conform(artifact: Artifact, row: Mapping[str, np.ndarray], *, constants: bool = False) -> Row:
    """Check a row, or the constants, against the schema, and convert it to the schema's dtypes; a `ValueError` is a bug of the stage."""
    declared = {name: array for name, array in artifact.arrays.items() if name not in COMMON and array.per_object != constants}
    optional = {name for name, array in declared.items() if array.optional}
    if missing := sorted(declared.keys() - row.keys() - optional):
        raise ValueError(f"{artifact.name}: the stage returned no {', '.join(missing)}")
    conformed: Row = {}
    for name, value in row.items():
        array = declared.get(name) or (artifact.of(name) if "/" in name else None)
        if array is None:
            raise ValueError(f"{artifact.name}: the stage returned {name}, which is not in its schema")
        dims = array.dims[1:] if array.per_object else array.dims
        if value.ndim != len(dims):
            raise ValueError(f"{artifact.name}: {name} has shape {value.shape}, the schema says {dims}")
        dtype = np.dtype(np.str_) if array.dtype == "string" else numpy_dtype(array)
        if not np.can_cast(value.dtype, dtype, "same_kind"):
            raise ValueError(f"{artifact.name}: {name} is {value.dtype}, the schema says {array.dtype}")
        with np.errstate(over="ignore"):  # values beyond float32 become infinite, and are refused below
            stored = value if array.dtype == "string" else value.astype(dtype)
        if not are_valid(array, stored):
            raise ValueError(f"{artifact.name}: {name} holds a value that is not finite as {array.dtype}; a kernel let it through")
        conformed[name] = stored
    return conformed


SIZE = 8  # bytes at the end of a file that hold the size of its footer
Chunks = Mapping[str, list[bytes]]  # the encoded chunks of a row, by array


class EncodedArray(Entries):
    """An array in a row file: its shape, its numpy dtype, and the sizes of its chunks, which follow one another."""

    shape: tuple[int, ...]
    dtype: str
    sizes: tuple[int, ...]


class Result(Entries):
    """The result of a unit: a row in a file, a `failure`, or a `bug` (its traceback)."""

    name: str  # of the unit, as `key`
    key: str
    digest: str = ""  # of the row and the object's category, or of the failure
    seconds: float = 0.0  # time that it took
    processor: str = ""  # the kind that computed it
    failure: Failure | None = None
    bug: str | None = None
    arrays: dict[str, EncodedArray] = Field(default={})  # the row's, in the order of their chunks in the file

    def record(self, category: str, split: str, inputs: dict[str, str]) -> RowRecord:
        """Describe the object's finished row as its shard's record does."""
        return RowRecord(
            object_id=self.name,
            category=category,
            split=split,
            key=self.key,
            digest=self.digest,
            inputs=inputs,
            seconds=round(self.seconds, 4),
            processor=self.processor,
            failure=self.failure,
        )


class RowFiles:
    """The row files below a work folder: one per unit and key, written atomically.

    `artifact` declares the arrays; without it, as for evaluations, each array is one chunk, not compressed.
    """

    def __init__(self, work: Location, artifact: Artifact | None = None) -> None:
        self.folder, self.artifact = work / "rows", artifact

    def path(self, name: str, key: str) -> Location:
        """Return the path of a unit's file."""
        return self.folder / name / f"{key}.row"

    def save(self, result: Result, row: Row, category: str = "") -> Result:
        """Write a unit's row or failure, and return its result. Nothing is flushed: a row lost in a power cut is computed again."""
        chunks = {name: encode_array(self._declaration(name), value) for name, value in row.items()}
        arrays = {
            name: EncodedArray(shape=value.shape, dtype=value.dtype.str, sizes=tuple(map(len, chunks[name]))) for name, value in row.items()
        }
        saved = result.model_copy(update={"digest": row_digest(row, result.failure, category), "arrays": arrays})
        footer = with_checksum(saved.model_dump_json().encode())
        content = [*(chunk for encoded in chunks.values() for chunk in encoded), footer, len(footer).to_bytes(SIZE, "little")]
        write_atomically(self.path(result.name, result.key), b"".join(content), durable=False)
        return saved

    def find(self, name: str, key: str) -> Result | None:
        """Read the result of a unit; None if its file is missing, damaged or of another unit. On a disk, only its footer is read."""
        path = self.path(name, key)
        try:
            if isinstance(path, Path):
                regular_stat(path)
                with path.open("rb") as file:
                    end = file.seek(-SIZE, os.SEEK_END)
                    size = min(int.from_bytes(file.read(), "little"), end)
                    file.seek(end - size)
                    footer = file.read(size)
            else:
                content = read_bytes(path)
                footer = content[-SIZE - int.from_bytes(content[-SIZE:], "little") : -SIZE]
            result = Result.model_validate_json(without_checksum(footer))
        except (OSError, ValueError, ValidationError):  # missing, or truncated by a full disk or a crash of the machine
            return None
        return result if (result.name, result.key) == (name, key) else None

    def chunks(self, result: Result) -> Chunks:
        """Read the encoded row of a result; if its file is gone or damaged, remove it and raise a `StoreError`."""
        path, offset = self.path(result.name, result.key), 0
        chunks: dict[str, list[bytes]] = {}
        try:
            content = read_bytes(path) if result.arrays else b""
            for name, array in result.arrays.items():
                chunks[name] = []
                for size in array.sizes:
                    without_checksum(chunk := content[offset : offset + size])
                    chunks[name].append(chunk)
                    offset += size
        except (FileNotFoundError, ValueError) as error:
            remove(path)
            raise StoreError(f"{path} was damaged or is gone; run again") from error
        return chunks

    def load(self, result: Result) -> Row:
        """Read the row of a result; errors are those of `chunks`."""
        chunks = self.chunks(result)
        return {
            name: decode_array(self._declaration(name), array.shape, array.dtype, chunks[name]) for name, array in result.arrays.items()
        }

    def discard(self, results: Iterable[Result]) -> None:
        """Remove the files of units; on a disk, where this run holds the lock, also those of other keys."""
        if isinstance(self.folder, Path):
            for result in results:
                remove(self.folder / result.name)
        else:
            remove_files(self.folder, [f"{result.name}/{result.key}.row" for result in results])

    def _declaration(self, name: str) -> Array | None:
        return self.artifact.of(name) if self.artifact else None

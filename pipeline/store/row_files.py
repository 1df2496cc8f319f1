"""Row files: one finished row each, encoded as it will be published, kept until its shard is, so that a killed run continues.

A file holds the row's chunks, one after the other, then a footer: the `Result` as JSON with its crc32c, and the footer's size. A file
that was cut short has no footer.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from pydantic import Field, ValidationError

from pipeline.errors import StoreError
from pipeline.formats.file_content import regular_stat
from pipeline.store.atomic import write_atomically
from pipeline.store.encode import decode_array, encode_array, with_checksum, without_checksum
from pipeline.store.record import Failure, Stored
from pipeline.store.rows import Row, row_digest
from pipeline.store.storage import Place, files_below, read_bytes, remove, remove_files
from schemas.base import Artifact

SIZE = 8
"""Bytes at the end of a file that say how large its footer is."""

Chunks = Mapping[str, list[bytes]]
"""The encoded chunks of a row, by array."""


class EncodedArray(Stored):
    """An array in a row file: its shape, its numpy dtype, and the sizes of its chunks, which follow one another."""

    shape: tuple[int, ...]
    dtype: str
    sizes: tuple[int, ...]


class Result(Stored):
    """A unit that is finished: its row is in a file, or there is none because of a `failure`, or of a `bug`, a traceback.

    Attributes
    ----------
    name, key
        Of the unit.
    digest
        Of the row and the object's category, or of the reason why there is none.
    seconds, processor
        How long it took, and the kind of processor that computed it.
    arrays
        The row's arrays, in the order of their chunks in the file.
    """

    name: str
    key: str
    digest: str = ""
    seconds: float = 0.0
    processor: str = ""
    failure: Failure | None = None
    bug: str | None = None
    arrays: dict[str, EncodedArray] = Field(default={})

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Map the names of the row's arrays to their shapes."""
        return {name: array.shape for name, array in self.arrays.items()}


class RowFiles:
    """The row files below a work folder: one per unit and key, each there only when it is whole.

    `artifact` declares the arrays; without it, as for evaluations, each array is one chunk, not compressed.
    """

    def __init__(self, work: Place, artifact: Artifact | None = None) -> None:
        self.folder, self.artifact = work / "rows", artifact

    def path(self, name: str, key: str) -> Place:
        """Return the path of a unit's file."""
        return self.folder / name / f"{key}.row"

    def save(self, result: Result, row: Row, category: str = "") -> Result:
        """Write a unit's row, or why there is none; a row that a power cut takes is made again.

        Parameters
        ----------
        result
            Of the unit, without digest and arrays.
        row
            Its arrays; none for a failure.
        category
            Of the object, which belongs to the digest.

        Returns
        -------
        The result with digest and arrays.
        """
        chunks = encode_row(self.artifact, row)
        arrays = {
            name: EncodedArray(shape=value.shape, dtype=value.dtype.str, sizes=tuple(map(len, chunks[name]))) for name, value in row.items()
        }
        saved = result.model_copy(update={"digest": row_digest(row, result.failure, category), "arrays": arrays})
        footer = with_checksum(saved.model_dump_json().encode())
        parts = [chunk for name in row for chunk in chunks[name]]
        write_atomically(
            self.path(result.name, result.key), b"".join([*parts, footer, len(footer).to_bytes(SIZE, "little")]), durable=False
        )
        return saved

    def find(self, name: str, key: str) -> Result | None:
        """Read the result of a unit; None where there is no file that can be read, or one of another unit."""
        try:
            result = Result.model_validate_json(without_checksum(_footer(self.path(name, key))))
        except (OSError, ValueError, ValidationError):  # missing, or cut short by a full disk or a crash of the machine
            return None
        return result if (result.name, result.key) == (name, key) else None

    def chunks(self, result: Result) -> Chunks:
        """Read the encoded row of a result.

        Raises
        ------
        StoreError
            The file is gone or damaged; it is removed.
        """
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
            raise StoreError(f"{path} was damaged and is removed; run again") from error
        return chunks

    def load(self, result: Result) -> Row:
        """Read the row of a result; errors are those of `chunks`."""
        chunks = self.chunks(result)
        return {
            name: decode_array(self.artifact.of(name) if self.artifact else None, array.shape, array.dtype, chunks[name])
            for name, array in result.arrays.items()
        }

    def discard(self, name: str, key: str) -> None:
        """Remove the file of a unit."""
        remove(self.path(name, key))

    def discard_all(self, keys: Mapping[str, str]) -> None:
        """Remove the files of units, given by name with their keys; on a disk, where this run holds the lock, those of other keys too."""
        if isinstance(self.folder, Path):
            for name in keys:
                remove(self.folder / name)
        else:
            remove_files(self.folder, [f"{name}/{key}.row" for name, key in keys.items()])

    def count(self) -> int:
        """Count the rows that wait to be published."""
        return sum(name.endswith(".row") for name in files_below(self.folder))


def encode_row(artifact: Artifact | None, row: Row) -> Chunks:
    """Encode a row, array by array."""
    return {name: encode_array(artifact.of(name) if artifact else None, value) for name, value in row.items()}


def _footer(path: Place) -> bytes:
    """Read the footer of a file; of one on a disk nothing else is read."""
    if not isinstance(path, Path):
        content = read_bytes(path)
        return content[-SIZE - int.from_bytes(content[-SIZE:], "little") : -SIZE]
    regular_stat(path)
    with path.open("rb") as file:
        end = file.seek(-SIZE, os.SEEK_END)
        size = min(int.from_bytes(file.read(), "little"), end)
        file.seek(end - size)
        return file.read(size)

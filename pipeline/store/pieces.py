"""Pieces: one object's finished row in a file, kept until its shard is packed, so that a killed run continues where it stopped."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from pydantic import ValidationError

from pipeline.formats.file_content import regular_stat
from pipeline.store.atomic import write_at_once
from pipeline.store.record import Failure
from pipeline.store.rows import Row, row_digest
from pipeline.store.storage import Place, files_below, read_bytes, remove, remove_files, temporary

UNREADABLE = (OSError, EOFError, zipfile.BadZipFile, KeyError, ValueError, ValidationError)
"""What reading a piece raises that is missing, or that a full disk or a crash of the machine cut short."""


@dataclass(frozen=True)
class PieceFacts:
    """What is known of an object's row without reading it.

    `shapes` are those of its arrays; `failure` says why there is no row; `processor` is the kind that computed it.
    """

    digest: str
    seconds: float
    shapes: dict[str, tuple[int, ...]]
    failure: Failure | None = None
    processor: str = ""


class Pieces:
    """The pieces of one artifact: one file per object and key, each there only when it is whole."""

    def __init__(self, work: Place) -> None:
        self.folder = work / "pieces"

    def path(self, object_id: str, key: str) -> Place:
        """Where a piece lies."""
        return self.folder / object_id / f"{key}.npz"

    def save(
        self, object_id: str, key: str, category: str, row: Row, *, seconds: float, failure: Failure | None = None, processor: str = ""
    ) -> PieceFacts:
        """Write an object's row, or why there is none, with its digest."""
        shapes = {name: array.shape for name, array in row.items()}
        facts = PieceFacts(row_digest(row, failure, category), seconds, shapes, failure, processor)
        described = {**facts.__dict__, "failure": failure and failure.model_dump(), "object_id": object_id, "key": key}
        named: dict[str, Any] = {f"row/{name}": array for name, array in row.items()}
        buffer = BytesIO()
        np.savez(buffer, facts=np.array(json.dumps(described)), **named)
        _write(self.path(object_id, key), buffer.getvalue())
        return facts

    def facts(self, object_id: str, key: str) -> PieceFacts | None:
        """Read what is known of a piece; None where there is none that can be read, or where it is another object's."""
        try:
            with self._open(object_id, key) as opened, np.load(opened, allow_pickle=False) as file:
                facts = json.loads(str(file["facts"]))
                if (facts["object_id"], facts["key"]) != (object_id, key):
                    return None
                failure = facts["failure"] and Failure.model_validate(facts["failure"])
                shapes = {name: tuple(shape) for name, shape in facts["shapes"].items()}
                return PieceFacts(facts["digest"], facts["seconds"], shapes, failure, facts["processor"])
        except UNREADABLE:
            return None

    def load(self, object_id: str, key: str, category: str, facts: PieceFacts) -> Row | None:
        """Read the row of a piece; None where it is not what `facts` says any more."""
        try:
            with self._open(object_id, key) as opened, np.load(opened, allow_pickle=False) as file:
                row = {name.removeprefix("row/"): file[name] for name in file.files if name != "facts"}
        except UNREADABLE:
            return None
        return row if row_digest(row, facts.failure, category) == facts.digest else None

    def _open(self, object_id: str, key: str) -> IO[bytes]:
        path = self.path(object_id, key)
        if not isinstance(path, Path):
            return BytesIO(read_bytes(path))
        regular_stat(path)
        return path.open("rb")

    def discard(self, object_id: str, key: str) -> None:
        """Forget a piece."""
        remove(self.path(object_id, key))

    def discard_all(self, keys: Mapping[str, str]) -> None:
        """Forget the pieces of these objects, given with their keys; on a disk, where this run holds the lock, those of other keys too."""
        if isinstance(self.folder, Path):
            for object_id in keys:
                remove(self.folder / object_id)
        else:
            remove_files(self.folder, [f"{object_id}/{key}.npz" for object_id, key in keys.items()])

    def count(self) -> int:
        """Count the rows that wait to be packed."""
        return sum(name.endswith(".npz") for name in files_below(self.folder))


def _write(path: Place, content: bytes) -> None:
    """Write a piece at once; on a disk without waiting for it, since a piece that a power cut took is made again."""
    if not isinstance(path, Path):
        write_at_once(path, content)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary(path) as beside:
        beside.write_bytes(content)
        beside.replace(path)

"""Pieces: one object's finished row, kept in the work area until its shard is packed, so that a killed run goes on where it was."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, np.ndarray]
"""One object's part of every array of an artifact, without the object dimension."""

_UNREADABLE = (OSError, EOFError, zipfile.BadZipFile, KeyError, ValueError)
"""A piece that is not there, or that a full disk or a crash of the machine cut short: it is made again."""


@dataclass(frozen=True)
class Piece:
    """What became of one object: its row, or the reason why there is none."""

    row: Row
    seconds: float
    failure: dict[str, str] | None = None

    @property
    def ok(self) -> bool:
        """Whether the object was processed."""
        return self.failure is None


@contextmanager
def unlink_on_error(path: Path) -> Iterator[None]:
    """Leave nothing half written behind, on a full disk least of all."""
    try:
        yield
    except BaseException:
        path.unlink(missing_ok=True)
        raise


class Pieces:
    """The pieces of one artifact: a file an object and key, each there only when it is whole."""

    def __init__(self, work: Path) -> None:
        self.work = work

    def path(self, object_id: str, key: str) -> Path:
        """Where a piece lies."""
        return self.work / "pieces" / object_id / f"{key}.npz"

    def save(self, object_id: str, key: str, piece: Piece) -> None:
        """Write a piece beside its place, then move it there."""
        path = self.path(object_id, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        facts = json.dumps({"seconds": piece.seconds, "failure": piece.failure})
        beside = path.with_suffix(f".{os.getpid()}.tmp")
        with unlink_on_error(beside), beside.open("wb") as file:
            named: dict[str, Any] = {f"row/{name}": array for name, array in piece.row.items()}
            np.savez(file, facts=np.array(facts), **named)
        beside.replace(path)

    def load(self, object_id: str, key: str) -> Piece | None:
        """The piece, or None where there is none that can be read."""
        try:
            with self.path(object_id, key).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                facts = json.loads(str(file["facts"]))
                row = {name.removeprefix("row/"): file[name] for name in file.files if name != "facts"}
        except _UNREADABLE:
            return None
        return Piece(row=row, **facts)

    def has(self, object_id: str, key: str) -> bool:
        """Whether a piece is there whole: a zip's directory stands at its end."""
        try:
            with self.path(object_id, key).open("rb") as opened, zipfile.ZipFile(opened):
                return True
        except _UNREADABLE:
            return False

    def discard(self, object_ids: Iterable[str]) -> None:
        """Forget every piece of these objects, whatever its key."""
        for object_id in object_ids:
            shutil.rmtree(self.work / "pieces" / object_id, ignore_errors=True)

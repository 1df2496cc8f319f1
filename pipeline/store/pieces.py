"""Pieces: one object's finished row in a file, kept until its shard is packed, so that a killed run continues where it stopped."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from pipeline.store.atomic import temporary
from pipeline.store.record import Failure
from pipeline.store.rows import Row, row_digest

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

    def __init__(self, work: Path) -> None:
        self.folder = work / "pieces"

    def path(self, object_id: str, key: str) -> Path:
        """Where a piece lies."""
        return self.folder / object_id / f"{key}.npz"

    def save(
        self, object_id: str, key: str, category: str, row: Row, *, seconds: float, failure: Failure | None = None, processor: str = ""
    ) -> PieceFacts:
        """Write an object's row, or why there is none, with its digest."""
        shapes = {name: array.shape for name, array in row.items()}
        facts = PieceFacts(row_digest(row, failure, category), seconds, shapes, failure, processor)
        path = self.path(object_id, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        described = {**facts.__dict__, "failure": failure and failure.model_dump(), "object_id": object_id, "key": key}
        with temporary(path) as beside:
            with beside.open("wb") as file:
                named: dict[str, Any] = {f"row/{name}": array for name, array in row.items()}
                np.savez(file, facts=np.array(json.dumps(described)), **named)
            beside.replace(path)
        return facts

    def facts(self, object_id: str, key: str) -> PieceFacts | None:
        """Read what is known of a piece; None where there is none that can be read, or where it is another object's."""
        try:
            with self.path(object_id, key).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
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
            with self.path(object_id, key).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                row = {name.removeprefix("row/"): file[name] for name in file.files if name != "facts"}
        except UNREADABLE:
            return None
        return row if row_digest(row, facts.failure, category) == facts.digest else None

    def discard(self, object_id: str, key: str) -> None:
        """Forget a piece."""
        self.path(object_id, key).unlink(missing_ok=True)

    def discard_all(self, object_ids: Iterable[str]) -> None:
        """Forget every piece of these objects, whatever its key."""
        for object_id in object_ids:
            shutil.rmtree(self.folder / object_id, ignore_errors=True)

    def count(self) -> int:
        """Count the rows that wait to be packed."""
        return sum(1 for _ in self.folder.glob("*/*.npz"))

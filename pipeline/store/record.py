"""The record of a folder that a set stage filled: what it was made from, and the digest of what is in it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from schemas.catalogue import ARTIFACTS

RECORD = "record.json"
LOGS = "tensorboard"
"""A folder in the folder that holds times of day, and hence belongs to no digest."""


@dataclass(frozen=True)
class Record:
    """A finished folder, and what `record.json` in it says."""

    folder: Path

    @cached_property
    def content(self) -> Mapping[str, Any]:
        """Key, settings, seed, inputs, models, facts, seconds, versions, and the hash of every file."""
        try:
            content: dict[str, Any] = json.loads((self.folder / RECORD).read_text())
        except (OSError, ValueError) as error:
            raise StoreError(f"{self.folder} is not there, or not finished ({error}); run the stage that fills it first") from error
        return content

    @property
    def digest(self) -> str:
        """The digest of the files: equal wherever the same was computed."""
        return digest.of_json(self.content["files"])

    def problems(self) -> list[str]:
        """Files that are missing, or differ from what was written."""
        try:
            written = self.content["files"]
        except StoreError as error:
            return [str(error)]
        standing = hashes_of(self.folder)
        lost = [f"{name} is missing" for name in written if name not in standing]
        changed = [name for name in written if name in standing and standing[name] != written[name]]
        return lost + [f"{name} differs from what was written (digest)" for name in changed]


def folders(root: Path) -> list[str]:
    """Names of the finished folders of a data directory, such as `models/unet` and `evaluation`, in order."""
    found = (path.parent.relative_to(root) for path in root.rglob(RECORD))
    return sorted(name.as_posix() for name in found if name.parts and not name.parts[0].startswith("."))


def hashes_of(folder: Path) -> dict[str, str]:
    """The SHA-256 of every file below a folder that its digest is made of."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    named = {path.relative_to(folder).as_posix(): path for path in files}
    counted = {name: path for name, path in named.items() if name != RECORD and not name.startswith(f"{LOGS}/")}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in counted.items()}


def rows_digest(collection: Collection, splits: Iterable[str]) -> str:
    """What a set stage depends on in an artifact: the rows of the splits' objects, their split, and the constants."""
    wanted = set(splits)
    rows = [
        (name, shard.split(name), shard.row_digest(name)) for name in collection if (shard := collection.shard(name)).split(name) in wanted
    ]
    constants = sorted({str(shard.attributes["constants_digest"]) for shard in collection.shards})
    return digest.of_json({"rows": rows, "constants": constants})


def standing_record(layout: Layout, name: str) -> Record:
    """The record of the folder `name` of a data directory, if it was made from what stands there now.

    Raises
    ------
    StoreError
        It is not there; or an artifact or folder that it was made from has changed since.
    """
    record = Record(layout.root / name)
    again = f"run {record.content['stage']} again"
    for artifact, made_from in record.content["inputs"].items():
        if rows_digest(Collection(layout, ARTIFACTS[artifact]), record.content["splits"]) != made_from:
            raise StoreError(f"{record.folder} was made from other {artifact} than stand in {layout.root} now; {again}")
    for other, made_from in record.content["models"].items():
        if standing_record(layout, other).digest != made_from:
            raise StoreError(f"{record.folder} was made from another {other} than stands in {layout.root} now; {again}")
    return record


def check_models(layout: Layout, collection: Collection) -> None:
    """A `StoreError` where an artifact was made with a model that is not the one that stands there now."""
    for shard in collection.shards:
        for name, made_from in shard.attributes.get("models", {}).items():
            if standing_record(layout, name).digest != made_from:
                raise StoreError(f"{shard.path} was made with another {name} than stands in {layout.root} now; run its stage again")

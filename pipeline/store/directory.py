"""A data directory: where everything lies, and whether what lies there was made from what lies there now."""

from __future__ import annotations

import hashlib
import re
import shlex
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import suppress
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import StoreError, first_line
from pipeline.store import digest
from pipeline.store.atomic import create
from pipeline.store.collection import Collection
from pipeline.store.record import FolderRecord, ShardRecord, read_record
from pipeline.store.shard import Shard
from pipeline.store.storage import Place, cache_of, copy, files_below, in_threads, names_in, place, read_bytes
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS
from schemas.folders import RECORD, TREES, maker_of

DESCRIPTION = "dataset.json"
WORK = ".work"
"""The folder of what is being made."""
LOGS = "tensorboard"
"""A folder in a folder that holds times of day, and hence belongs to no digest."""

SHARD_RECORD = "[0-9][0-9][0-9][0-9]-of-[0-9][0-9][0-9][0-9].json"
"""What the record of a shard is called."""

_VERSION = re.compile(r".+-[0-9a-f]{16}(\.zarr)?")

T = TypeVar("T")


class DatasetDescription(BaseModel):
    """What `dataset.json` says: into how many shards the objects are split."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    shards: int = Field(ge=1, le=9999)


class DataDirectory:
    """A data directory, read as it is when something is first asked for.

    `ARTIFACT/NNNN-of-NNNN.json` are the records of shards, `models/unet.json` that of a folder; beside them lie the groups and folders
    that they name, and in `.work` what is being made.
    """

    def __init__(self, root: str | Place) -> None:
        self.root = place(root)
        self._collections: dict[str, Collection] = {}

    # ---- shards

    def shards(self) -> int | None:
        """Into how many shards the objects are split; None before the first run."""
        return self._steadily(self._shards)

    def _steadily(self, read: Callable[[], T]) -> T:
        """Read records; again, where `reshard` has replaced them meanwhile."""
        while True:
            before = self._description()
            try:
                found = read()
            except StoreError:
                if self._description() == before:
                    raise
            else:
                if self._description() == before:
                    return found

    def _description(self) -> bytes:
        with suppress(OSError):
            return read_bytes(self.root / DESCRIPTION)
        return b""

    def _shards(self) -> int | None:
        path = self.root / DESCRIPTION
        there = {path.stem.rpartition("-")[2] for path in self.shard_records()}
        numbers = ", ".join(str(int(number)) for number in sorted(there))
        remedy = f'write {{"shards": N}} into it, N as the records are named: {numbers or "none is left"}'
        try:
            shards = DatasetDescription.model_validate_json(read_bytes(path)).shards
        except FileNotFoundError:
            if len(there) > 1:
                raise StoreError(f"{path} is missing; {remedy}") from None
            return int(there.pop()) if there else None
        except (OSError, ValidationError) as error:
            raise StoreError(f"{path} is damaged ({first_line(error)}); {remedy}") from error
        if there and f"{shards:04d}" not in there:
            raise StoreError(f"{path} says {shards} shards, and no record is of that number; {remedy}")
        return shards

    def check_shard_count(self, count: int | None) -> int:
        """Settle on a number of shards: the dataset's own, before the first run the one asked for, or 1.

        Raises
        ------
        StoreError
            The dataset has another number than the one asked for.
        """
        current = self.shards()
        if current is not None and count not in (None, current):
            raise StoreError(
                f"{self.root} is split into {current} shards, {count} were asked for; leave --shards (make: SHARDS=) out, "
                f"or change the number with `vt-pipeline reshard {shlex.quote(str(self.root))} {count}`"
            )
        return current or count or 1

    def set_shard_count(self, count: int) -> None:
        """Write down the number of shards, unless another run was first; a `StoreError` where that chose another number."""
        create(self.root / DESCRIPTION, DatasetDescription(shards=count).model_dump_json().encode())
        self.check_shard_count(count)

    def shard_record(self, artifact: str, number: int, shards: int) -> Place:
        """The path of a shard's record."""
        return self.root / artifact / f"{shard_name(number, shards)}.json"

    def shard_records(self, *artifacts: str) -> list[Place]:
        """The paths of all records of shards, of these artifacts or of all, whatever number of shards they are of."""
        there = artifacts or sorted(name for name, is_folder in names_in(self.root).items() if is_folder)
        folders = [self.root / name for name in there]
        return [folder / name for folder in folders for name in sorted(names_in(folder)) if fnmatch(name, SHARD_RECORD)]

    def collection(self, artifact: Artifact) -> Collection:
        """The published shards of an artifact."""
        if artifact.name not in self._collections:
            self._collections[artifact.name] = self._steadily(lambda: self._collection(artifact))
        return self._collections[artifact.name]

    def _collection(self, artifact: Artifact) -> Collection:
        folder, shards = self.root / artifact.name, self.shards()
        records = [path for path in self.shard_records(artifact.name) if is_of(path, shards)]
        read_one = partial(read_record, kind=ShardRecord)
        read = list(map(read_one, records)) if isinstance(folder, Path) else in_threads(read_one, records)
        return Collection(folder, artifact, [Shard(folder, artifact, record) for record in read])

    def artifacts(self) -> list[Artifact]:
        """The artifacts that have a published shard."""
        return [artifact for artifact in ARTIFACTS.values() if self.collection(artifact).shards]

    # ---- folders

    def folder_record(self, name: str) -> Place:
        """The path of the record of a folder that a dataset stage fills, such as `models/unet`."""
        return self.root / f"{name}.json"

    def folders(self) -> list[str]:
        """Names of the folders that were published."""
        trees = (f"{where}/{name}" for where in TREES for name in files_below(self.root / where))
        found = [name for name in names_in(self.root) if RECORD.fullmatch(name)]
        found += [path for path in trees if path.endswith(".json") and not any(map(is_version, path.split("/")))]
        return sorted(path.removesuffix(".json") for path in found)

    def record_folders(self) -> list[Place]:
        """The folders that hold records, or held one that was deleted."""
        found = {"", *ARTIFACTS}
        for where in TREES:
            for name in files_below(self.root / where):
                parts = f"{where}/{name}".split("/")[:-1]
                found.add("/".join(parts[: next((at for at, part in enumerate(parts) if is_version(part)), len(parts))]))
        return [self.root / name for name in sorted(found)]

    def folder(self, name: str) -> FolderRecord:
        """The record of a folder; a `StoreError` where there is none."""
        return read_record(self.folder_record(name), FolderRecord, maker_of(name))

    def folder_path(self, name: str) -> Place:
        """The folder that the record names."""
        return (self.root / name).with_name(self.folder(name).location)

    def folder_problems(self, name: str) -> Iterator[str]:
        """Compare the files that the record of a folder names with what it says: a line for each that differs."""
        folder = self.folder_path(name)
        return _differences(self.folder(name), folder, folder)

    def whole_folder(self, name: str) -> Path:
        """The folder that the record names, to be read on this machine's disk, where one in object storage is copied to.

        Raises
        ------
        StoreError
            A file of it is missing or was changed.
        """
        record, folder = self.folder(name), self.folder_path(name)
        local = folder if isinstance(folder, Path) else cache_of(folder)
        if local != folder and changed_files(local, record.files):
            copy(folder, local, files_below(folder).keys() & record.files)
        if problem := next(_differences(record, local, folder), None):
            raise StoreError(f"{folder}: {problem}")
        return local

    # ---- what is being made

    def work(self, name: str) -> Place:
        """Where an artifact or folder is made until it is whole."""
        return self.root / WORK / name

    def shard_lock(self, artifact: str, number: int, shards: int) -> Place:
        """The lock of whoever makes a shard."""
        return self.work(artifact) / f"{shard_name(number, shards)}.lock"

    # ---- origins

    def check_origins(self, names: Iterable[str], objects: Container[str] | None = None) -> None:
        """Check that artifacts and folders, and whatever they were made from, were made from what lies here now.

        Parameters
        ----------
        names
            Of artifacts (`touch`) and folders (`models/unet`).
        objects
            Look at the rows of these objects alone; at all where none are named.

        Raises
        ------
        StoreError
            One was not: it names both, and the stage to run again.
        """
        checked: set[str] = set()
        waiting = list(names)
        while waiting:
            name = waiting.pop()
            if name not in checked:
                checked.add(name)
                waiting += self._check_artifact(name, objects) if name in ARTIFACTS else self._check_folder(name)

    def _check_artifact(self, name: str, objects: Container[str] | None) -> list[str]:
        """Check an artifact; returns the names of what it was made from."""
        collection = self.collection(ARTIFACTS[name])
        used: set[str] = set()
        for shard in collection.shards:
            again = f"run {shard.record.stage} again"
            used |= shard.record.models.keys()
            for model, made_with in shard.record.models.items():
                if folder_digest(self.folder(model)) != made_with:
                    raise StoreError(f"{shard.path} was made with another {model} than the current one; {again}")
            for row in shard.record.rows:
                if objects is not None and row.object_id not in objects:
                    continue
                used |= row.inputs.keys() & ARTIFACTS.keys()
                for origin in row.inputs.keys() & ARTIFACTS.keys():
                    current = self.collection(ARTIFACTS[origin])
                    if current.shards and (row.object_id not in current or current.row(row.object_id).digest != row.inputs[origin]):
                        raise StoreError(
                            f"{shard.path}: {name} of {row.object_id} was made from other {origin} than the current ones; {again}"
                        )
        return sorted(used)

    def _check_folder(self, name: str) -> list[str]:
        record, path = self.folder(name), self.folder_record(name)
        again = f"run {record.stage} again with the settings in {path}, or delete that file if this folder is no longer needed"
        if unknown := sorted(record.inputs.keys() - ARTIFACTS.keys()):
            raise StoreError(f"{path}: there is no artifact {unknown[0]}; delete the record and run {record.stage} again")
        for artifact, made_from in record.inputs.items():
            if self.collection(ARTIFACTS[artifact]).rows_digest(record.splits) != made_from:
                raise StoreError(f"{self.root / name} was made from other {artifact} than the current ones; {again}")
        for model, made_with in record.models.items():
            if folder_digest(self.folder(model)) != made_with:
                raise StoreError(f"{self.root / name} was made from another {model} than the current one; {again}")
        return [*record.inputs, *record.models]


def _differences(record: FolderRecord, read: Place, folder: Place) -> Iterator[str]:
    """Compare the files of a folder, read there or as a copy, with what its record says: a line for each that differs."""
    for file, problem in changed_files(read, record.files).items():
        yield f"{file} {problem}; delete {folder} and run {record.stage} again"


def changed_files(folder: Place, files: Mapping[str, str]) -> dict[str, str]:
    """Compare files below a folder with the SHA-256 of when they were written: the problem of each that differs, by name."""
    there = _hashes(folder, files)
    problems = {name: "differs from what was written" if name in there else "is missing" for name in files}
    return {name: problem for name, problem in problems.items() if there.get(name) != files[name]}


def shard_name(number: int, shards: int) -> str:
    """What the record of a shard is called, and its groups begin with."""
    return f"{number:04d}-of-{shards:04d}"


def is_of(record: Place, shards: int | None) -> bool:
    """Whether the record of a shard is of a dataset that is split into that number."""
    return record.stem.endswith(f"-of-{shards or 0:04d}")


def versioned(name: str, content: object) -> str:
    """Name a group or folder after its content, so that writing one never changes what readers of another see."""
    return f"{name}-{digest.of_json(content)[:16]}"


def is_version(name: str) -> bool:
    """Whether a group or folder is called as `versioned` calls them."""
    return _VERSION.fullmatch(name) is not None


def unversioned(name: str) -> str:
    """What was named by `versioned`."""
    return name.rpartition("-")[0]


def folder_digest(record: FolderRecord) -> str:
    """Compute the digest of a folder's files: equal wherever the same was computed."""
    return digest.of_json(record.files)


def hashes_of(folder: Place) -> dict[str, str]:
    """Compute the SHA-256 of every file below a folder that its digest is made of."""
    return _hashes(folder, files_of(folder))


def _hashes(folder: Place, names: Iterable[str]) -> dict[str, str]:
    """Compute the SHA-256 of files below a folder; one that is no file has none."""

    def sha256(name: str) -> str | None:
        with suppress(FileNotFoundError, IsADirectoryError, NotADirectoryError):
            return hashlib.sha256(read_bytes(folder / name)).hexdigest()
        return None

    files = list(names)
    return {name: written for name, written in zip(files, in_threads(sha256, files), strict=True) if written}


def files_of(folder: Place) -> list[str]:
    """List the files below a folder that its digest is made of."""
    return [name for name in sorted(files_below(folder)) if not name.startswith(f"{LOGS}/")]

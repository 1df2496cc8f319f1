"""Data directories: the paths of shards, folders and records, and whether each was made from the current inputs."""

import fnmatch
import hashlib
import re
import shlex
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

from pydantic import Field, ValidationError

from pipeline.console import pluralise
from pipeline.entries import Entries
from pipeline.errors import StoreError, first_line
from pipeline.formats.file_content import without_mark
from pipeline.store import digest
from pipeline.store.atomic import create
from pipeline.store.collection import Collection
from pipeline.store.digest import hashes_of
from pipeline.store.record import FolderRecord, ShardRecord, read_record
from pipeline.store.shard import Shard
from pipeline.store.storage import Location, as_location, cache_of, copy, exists, files_below, list_folder, map_in_threads, read_bytes
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS
from schemas.folders import RECORD, TREES, maker_of

DESCRIPTION = "dataset.json"
WORK = ".work"
"""The folder of unfinished work."""
SHARD_RECORD = "[0-9][0-9][0-9][0-9]-of-[0-9][0-9][0-9][0-9].json"
"""The pattern of the names of shards' records."""

_VERSION = re.compile(r".+-[0-9a-f]{16}(\.zarr)?")


class DatasetDescription(Entries):
    """The content of `dataset.json`: the number of shards that the objects are split into."""

    shards: int = Field(ge=1, le=9999)


class DataDirectory:
    """A data directory. Each artifact is read when it is first used.

    `ARTIFACT/NNNN-of-NNNN.json` are the records of shards, `NAME.json` that of the folder `NAME`; the groups and folders that they
    name lie beside them, unfinished ones in `.work`.
    """

    def __init__(self, root: str | Location) -> None:
        self.root = as_location(root)
        self._collections: dict[str, Collection] = {}

    def is_data_directory(self) -> bool:
        """Check whether the folder is a data directory: it has a description, or a record."""
        return exists(self.root / DESCRIPTION) or bool(self.shard_records(*ARTIFACTS) or self.folders())

    def shards(self) -> int | None:
        """Read the number of shards that the objects are split into; None before the first run."""
        path = self.root / DESCRIPTION
        recorded = sorted({int(path.stem.rpartition("-")[2]) for path in self.shard_records()})
        remedy = f'write {{"shards": N}} into it, N as the records are named: {", ".join(map(str, recorded)) or "none is left"}'
        try:
            shards = DatasetDescription.model_validate_json(without_mark(path, read_bytes(path))).shards
        except FileNotFoundError:
            if len(recorded) > 1:
                raise StoreError(f"{path} is missing; {remedy}") from None
            return recorded[0] if recorded else None
        except NotADirectoryError:
            raise StoreError(f"{self.root} is a file, or below one; give a data directory, which `vt-pipeline run` makes") from None
        except (OSError, ValidationError) as error:
            raise StoreError(f"{path} is damaged ({first_line(error)}); {remedy}") from error
        if recorded and shards not in recorded:
            raise StoreError(f"{path} names {pluralise(shards, 'shard')}, but no record has that number; {remedy}")
        return shards

    def check_shard_count(self, count: int | None) -> int:
        """Return the dataset's number of shards; before the first run the requested one, or 1. Refuse another number than requested."""
        current = self.shards()
        if current is not None and count not in (None, current):
            raise StoreError(
                f"{self.root} is split into {pluralise(current, 'shard')}, {count} were asked for; leave --shards (make: SHARDS=) out, "
                f"or make the dataset in another folder: --data FOLDER --reuse {shlex.quote(str(self.root))} copies its rows"
            )
        return current or count or 1

    def set_shard_count(self, count: int) -> None:
        """Store the number of shards, unless another run has; raise a `StoreError` if that run chose another number."""
        create(self.root / DESCRIPTION, DatasetDescription(shards=count).model_dump_json().encode())
        self.check_shard_count(count)

    def shard_record(self, artifact: str, number: int, shards: int) -> Location:
        """Return the path of a shard's record."""
        return self.root / artifact / f"{shard_name(number, shards)}.json"

    def shard_records(self, *artifacts: str) -> list[Location]:
        """List the paths of all records of shards, of these artifacts or of all, of any number of shards."""
        records: list[Location] = []
        for artifact in artifacts or sorted(name for name, is_folder in list_folder(self.root).items() if is_folder):
            folder = self.root / artifact
            records += map(folder.joinpath, fnmatch.filter(sorted(list_folder(folder)), SHARD_RECORD))
        return records

    def collection(self, artifact: Artifact) -> Collection:
        """Open the published shards of an artifact."""
        if artifact.name not in self._collections:
            folder, shards = self.root / artifact.name, self.shards()
            paths = [path for path in self.shard_records(artifact.name) if has_shard_count(path, shards)]
            records = map_in_threads(partial(read_record, kind=ShardRecord), paths)
            self._collections[artifact.name] = Collection(folder, artifact, [Shard(folder, artifact, record) for record in records])
        return self._collections[artifact.name]

    def artifacts(self) -> list[Artifact]:
        """List the artifacts that have a published shard."""
        return [artifact for artifact in map(ARTIFACTS.__getitem__, self.artifact_names()) if self.collection(artifact).shards]

    def artifact_names(self) -> list[str]:
        """List the artifacts that have a folder, or one of unfinished work; plugins without one are not imported."""
        folder_names = list_folder(self.root).keys() | list_folder(self.root / WORK).keys()
        return [name for name in ARTIFACTS if name in folder_names]

    def folder_record(self, name: str) -> Location:
        """Return the path of a folder's record."""
        return self.root / f"{name}.json"

    def folders(self) -> list[str]:
        """List the names of the published folders."""
        trees = (f"{where}/{name}" for where in TREES for name in files_below(self.root / where))
        records = [name for name in list_folder(self.root) if RECORD.fullmatch(name)]
        records += [path for path in trees if path.endswith(".json") and not any(map(is_version, path.split("/")))]
        return sorted(path.removesuffix(".json") for path in records)

    def record_folders(self) -> list[Location]:
        """List the folders that hold records, or held one that was deleted."""
        folders = {"", *ARTIFACTS}
        for where in TREES:
            for name in files_below(self.root / where):
                parts = f"{where}/{name}".split("/")[:-1]
                folders.add("/".join(parts[: next((index for index, part in enumerate(parts) if is_version(part)), len(parts))]))
        return [self.root / name for name in sorted(folders)]

    def folder(self, name: str) -> FolderRecord:
        """Read the record of a folder; a `StoreError` where there is none."""
        return read_record(self.folder_record(name), FolderRecord, maker_of(name))

    def folder_path(self, name: str) -> Location:
        """Return the path of the folder that a record names."""
        return (self.root / name).with_name(self.folder(name).location)

    def folder_problems(self, name: str, local: Path | None = None) -> Iterator[str]:
        """Compare the files of a folder, or of its local copy, with its record; yield a line for each that differs."""
        record, folder = self.folder(name), self.folder_path(name)
        for file, problem in changed_files(local or folder, record.files).items():
            yield f"{file} {problem}; delete {folder} and run {made_by(name, record)} again"

    def verified_folder(self, name: str) -> Path:
        """Return the folder that a record names, or a local copy if it is in object storage; refuse missing or changed files."""
        record, folder = self.folder(name), self.folder_path(name)
        local = folder if isinstance(folder, Path) else cache_of(folder)
        if local != folder and changed_files(local, record.files):
            copy(folder, local, files_below(folder).keys() & record.files)
        if problem := next(self.folder_problems(name, local), None):
            raise StoreError(f"{folder}: {problem}")
        return local

    def work(self, name: str) -> Location:
        """Return the work folder of an artifact or folder."""
        return self.root / WORK / name


def made_by(name: str, record: FolderRecord) -> str:
    """Name what makes a folder: the stage in its record, or the command for scores, whose stage cannot be run alone."""
    return maker_of(name) if name.startswith("scores/") else record.stage


def changed_files(folder: Location, files: Mapping[str, str]) -> dict[str, str]:
    """Compare files below a folder with their recorded SHA-256; return the problem of each that differs, by name."""
    hashes = hashes_of(folder, files)
    problems = {name: "differs from what was written" if name in hashes else "is missing" for name in files}
    return {name: problem for name, problem in problems.items() if hashes.get(name) != files[name]}


def shard_of(object_id: str, shards: int) -> int:
    """Compute the number of an object's shard from its name alone: adding or removing other objects does not move it."""
    return int(hashlib.sha256(object_id.encode()).hexdigest(), 16) % shards


def shard_name(number: int, shards: int) -> str:
    """Name the record of a shard; the names of its groups begin with it."""
    return f"{number:04d}-of-{shards:04d}"


def has_shard_count(record: Location, shards: int | None) -> bool:
    """Check whether a record belongs to a dataset with this number of shards."""
    return record.stem.endswith(f"-of-{shards or 0:04d}")


def versioned(name: str, content: object) -> str:
    """Name a group or folder after its content, so that writing one never changes what readers of another see."""
    return f"{name}-{digest.of_json(content)[:16]}"


def is_version(name: str) -> bool:
    """Check whether a group or folder has a name made by `versioned`."""
    return _VERSION.fullmatch(name) is not None


def unversioned(name: str) -> str:
    """Return the name that `versioned` was given."""
    return name.rpartition("-")[0]

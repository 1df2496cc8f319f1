"""Data directories: the paths of shards, folders and records, and all shards of an artifact as one collection of objects."""

import fnmatch
import hashlib
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from itertools import takewhile
from pathlib import Path

from pydantic import Field, ValidationError

from pipeline.console import pluralise
from pipeline.entries import Entries
from pipeline.errors import StoreError, first_line
from pipeline.formats.file_content import without_mark
from pipeline.store import digest
from pipeline.store.atomic import create
from pipeline.store.digest import hashes_of
from pipeline.store.record import Failure, FolderRecord, RowRecord, ShardRecord, read_record
from pipeline.store.rows import RowFiles
from pipeline.store.shard import RowView, Shard
from pipeline.store.storage import Location, as_location, cache_of, copy, exists, files_below, list_folder, map_in_threads, read_bytes
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS
from schemas.folders import RECORD, TREES, maker_of

DESCRIPTION = "dataset.json"
WORK = ".work"  # the folder of unfinished work
SHARD_RECORD = "[0-9][0-9][0-9][0-9]-of-[0-9][0-9][0-9][0-9].json"  # the pattern of the names of shards' records
_VERSION = re.compile(r"(.+)-[0-9a-f]{16}(\.zarr)?")


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

    def check_exists(self) -> None:
        """Raise a `StoreError` if the folder is no data directory: it has neither a description nor a record."""
        if not (exists(self.root / DESCRIPTION) or self.shard_records(*ARTIFACTS) or self.folders()):
            raise StoreError(f"{self.root} is not a data directory; make one with `vt-pipeline run`, or name another")

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
        return self.root / artifact / f"{number:04d}-of-{shards:04d}.json"

    def shard_records(self, *artifacts: str) -> list[Location]:
        """List the paths of all records of shards, of these artifacts or of all, of any number of shards."""
        records: list[Location] = []
        for artifact in artifacts or sorted(name for name, is_folder in list_folder(self.root).items() if is_folder):
            folder = self.root / artifact
            records += map(folder.joinpath, fnmatch.filter(sorted(list_folder(folder)), SHARD_RECORD))
        return records

    def collection(self, artifact: Artifact) -> "Collection":
        """Open the published shards of an artifact."""
        if artifact.name not in self._collections:
            folder, shards = self.root / artifact.name, self.shards()
            paths = [path for path in self.shard_records(artifact.name) if path.stem.endswith(f"-of-{shards or 0:04d}")]
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
        records += [path for path in trees if path.endswith(".json") and not any(map(record_of, path.split("/")))]
        return sorted(path.removesuffix(".json") for path in records)

    def record_folders(self) -> list[Location]:
        """List the folders that hold records, or held one that was deleted."""
        folders = {"", *ARTIFACTS}
        for where in TREES:
            for name in files_below(self.root / where):
                parents = takewhile(lambda part: not record_of(part), f"{where}/{name}".split("/")[:-1])
                folders.add("/".join(parents))
        return [self.root / name for name in sorted(folders)]

    def folder(self, name: str) -> FolderRecord:
        """Read the record of a folder; a `StoreError` where there is none."""
        return read_record(self.folder_record(name), FolderRecord, maker_of(name, self.root))

    def folder_path(self, name: str) -> Location:
        """Return the path of the folder that a record names."""
        return (self.root / name).with_name(self.folder(name).location)

    def folder_problems(self, name: str, local: Path | None = None) -> list[str]:
        """Compare the files of a folder, or of its local copy, with its record; return a line for each that differs."""
        record, folder = self.folder(name), self.folder_path(name)
        remedy = f"delete {folder} and run {made_by(name, record)} again"
        return [f"{file} {problem}; {remedy}" for file, problem in changed_files(local or folder, record.files).items()]

    def verified_folder(self, name: str) -> Path:
        """Return the folder that a record names, or a local copy if it is in object storage; refuse missing or changed files."""
        record, folder = self.folder(name), self.folder_path(name)
        local = folder if isinstance(folder, Path) else cache_of(folder)
        if local != folder and changed_files(local, record.files):
            copy(folder, local, files_below(folder).keys() & record.files)
        if problems := self.folder_problems(name, local):
            raise StoreError(f"{folder}: {problems[0]}")
        return local

    def work(self, name: str) -> Location:
        """Return the work folder of an artifact or folder."""
        return self.root / WORK / name

    def rows(self, artifact: Artifact) -> RowFiles:
        """Open the rows of an artifact that wait to be published."""
        return RowFiles(self.work(artifact.name), artifact)


class Collection:
    """The objects of an artifact whose shards have been published."""

    def __init__(self, folder: Location, artifact: Artifact, shards: Sequence[Shard]) -> None:
        self.folder = folder
        self.artifact = artifact
        self.shards = shards
        stage = shards[0].record.stage if shards else artifact.stage
        self._maker = f"`vt-pipeline run {stage} --data {shlex.quote(str(folder.parent))}`"
        self._shard_of = {object_id: shard for shard in shards for object_id in shard.position}

    def __contains__(self, object_id: object) -> bool:
        return object_id in self._shard_of

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._shard_of))

    def __len__(self) -> int:
        return len(self._shard_of)

    def shard(self, object_id: str) -> Shard:
        """Find the shard that holds an object; raise a `StoreError` if none does."""
        try:
            return self._shard_of[object_id]
        except KeyError:
            self._check_made()
            raise StoreError(
                f"{self.folder}, of manifest {self.shards[0].record.manifest}, has no object {object_id}; name that manifest, or "
                f"run {self._maker} first, for all objects"
            ) from None

    def row(self, object_id: str) -> RowRecord:
        """Return the record of an object's row."""
        return self.shard(object_id).row(object_id)

    @cached_property
    def missing(self) -> dict[str, Failure]:
        """The objects that incomplete shards lack, each as a failure."""
        lacking = sorted((name, shard.record.stage) for shard in self.shards for name in shard.record.missing)
        return {name: Failure(stage=stage, reason="not made yet") for name, stage in lacking}

    def failure(self, object_id: str) -> Failure | None:
        """Return the reason why an object has no row; None where it has one."""
        return self.missing.get(object_id) or self.row(object_id).failure

    def view(self, object_id: str) -> RowView:
        """Open an object's row."""
        return RowView(self.shard(object_id), object_id)

    @cached_property
    def first(self) -> Shard:
        """The first shard with a row: others lack sizes. Settings, attributes and constants are the same in all."""
        self._check_made()
        self.check_alike()
        return next((shard for shard in self.shards if shard.has_rows), self.shards[0])

    def _check_made(self) -> None:
        if not self.shards:
            raise StoreError(f"{self.folder} has not been made; run {self._maker} first")

    def check_alike(self) -> None:
        """Raise a `StoreError` if shards differ in settings, seed, models or constants: they do not belong together."""
        for other in (shard.record for shard in self.shards[1:]):
            first = self.shards[0].record
            remedy = f"run {self._maker} for all shards"
            made, made_otherwise = first.made_with(), other.made_with()
            if names := [name for name in {**made, **made_otherwise} if made.get(name) != made_otherwise.get(name)]:
                differences = [f"{name} {made.get(name, 'unset')} and {made_otherwise.get(name, 'unset')}" for name in names]
                numbers = " and ".join(record.location.rpartition("-")[0] for record in (first, other))
                raise StoreError(
                    f"{self.folder}: its shards {numbers} were made with different settings ({'; '.join(differences)}); "
                    f"{remedy} with the same --preset, --set and --seed"
                )
            if first.constants_digest != other.constants_digest:
                raise StoreError(f"{self.folder} has shards of different scenes or sensors; {remedy}")

    def processors(self) -> Counter[str]:
        """Count the rows by the kind of processor that computed them."""
        return Counter(row.processor for shard in self.shards for row in shard.record.rows if row.processor)

    def digest(self) -> str:
        """Compute the digest of all objects; it depends neither on the number of shards nor on the versions that made them."""
        shared = {
            digest.of_json([shard.record.constants_digest, {k: v for k, v in shard.attributes.items() if k != "failures"}])
            for shard in self.shards
        }
        rows = ((row.object_id, f"{row.digest} {row.split}") for shard in self.shards for row in shard.record.rows)
        return digest.of_rows(rows, {"shared": sorted(shared)})

    def rows_digest(self, splits: Iterable[str]) -> str:
        """Compute the digest of what a dataset stage depends on: the rows of the splits' objects, their split, and the constants."""
        split_names = set(splits)
        rows = [(name, row.split, row.digest) for name in self if (row := self.row(name)).split in split_names]
        constants = sorted({shard.record.constants_digest for shard in self.shards})
        return digest.of_json({"rows": rows, "constants": constants})


def made_by(name: str, record: FolderRecord) -> str:
    """Name what makes a folder: the stage in its record, or the command for scores, whose stage cannot be run alone."""
    return maker_of(name, "DATA") if name.startswith("scores/") else record.stage


def changed_files(folder: Location, files: Mapping[str, str]) -> dict[str, str]:
    """Compare files below a folder with their recorded SHA-256; return the problem of each that differs, by name."""
    hashes = hashes_of(folder, files)
    problems = {name: "differs from what was written" if name in hashes else "is missing" for name in files}
    return {name: problem for name, problem in problems.items() if hashes.get(name) != files[name]}


def shard_of(object_id: str, shards: int) -> int:
    """Compute the number of an object's shard from its name alone: adding or removing other objects does not move it."""
    return int(hashlib.sha256(object_id.encode()).hexdigest(), 16) % shards


def versioned(name: str, content: object) -> str:
    """Name a group or folder after its content, so that writing one never changes what readers of another see."""
    return f"{name}-{digest.of_json(content)[:16]}"


def record_of(version: str) -> str:
    """Return the name of the record of a group or folder that `versioned` named; "" for another name."""
    named = _VERSION.fullmatch(version)
    return f"{named[1]}.json" if named else ""

"""Publish outputs: each version of a shard or folder is written under a new name, then named by its record."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import StoreError
from pipeline.store.atomic import move_folder, replace_version, version_of
from pipeline.store.directory import DataDirectory, changed_files, shard_name, versioned
from pipeline.store.garbage import collect, mark_replaced
from pipeline.store.local_copy import local_copy
from pipeline.store.record import FolderRecord, Provenance, ShardRecord, named_location, read_record, serialise_with_checksum
from pipeline.store.row_files import Chunks, RowFiles
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from pipeline.store.storage import Location, files_below, remove
from pipeline.store.validate import problems_of
from pipeline.store.write import Shapes, metadata_digests, write_group
from schemas.base import Artifact


class ShardOutput:
    """A shard of an artifact: its paths, its published version, and the rows that wait to be published.

    `path` is the record's without its suffix, as messages name the shard; a run holds `lock` while it makes the shard.
    `shard` and its `record` are None if none is published, or it cannot be used.
    """

    def __init__(self, directory: DataDirectory, artifact: Artifact, number: int, shards: int) -> None:
        self.directory, self.artifact, self.shards, self.name = directory, artifact, shards, shard_name(number, shards)
        self.path, self.work = directory.root / artifact.name / self.name, directory.work(artifact.name)
        self.record_path = directory.shard_record(artifact.name, number, shards)
        self.lock = directory.shard_lock(artifact.name, number, shards)
        self.rows = RowFiles(self.work, artifact)
        self.refresh()

    def refresh(self) -> None:
        """Read again what is published."""
        try:
            self.shard: Shard | None = Shard(self.record_path.parent, self.artifact, read_record(self.record_path, ShardRecord))
        except StoreError:
            self.shard = None
        self.record = None if self.shard is None else self.shard.record

    def is_complete(self) -> bool:
        """Check that every file of the published shard exists and is not empty."""
        return self.shard is not None and self.shard.is_complete()

    def is_sound(self) -> bool:
        """Check that the published shard holds what was written, by reading every value."""
        return self.shard is not None and not problems_of(self.shard)

    def commit(
        self,
        record: ShardRecord,
        shapes: Sequence[Shapes],
        chunks: Callable[[int], Chunks],
        constants: Row,
        attributes: Mapping[str, Any],
    ) -> Location:
        """Write the group of the record's rows, and publish the record with the group's name; return the group's path.

        Parameters are those of `write_group`, except `record`, whose location is filled in. In object storage, a
        `StoreError` says that another run has published meanwhile.
        """
        location = versioned(self.name, [record.key, [row.digest for row in record.rows]]) + ".zarr"
        path, version = self.path.with_name(location), version_of(self.record_path)
        with local_copy(self.work, begin=False) as work:
            for unfinished in work.glob(f"{self.name}-*.zarr"):  # of a run that was killed
                shutil.rmtree(unfinished, ignore_errors=True)
            group = work / location
            write_group(group, self.artifact, record.rows, shapes, chunks, constants, attributes)
            written = {"location": location, "metadata": metadata_digests(group, self.artifact)}
            _publish(self.directory, group, path, self.record_path, record, written, version)
        self.refresh()
        return path


class FolderOutput:
    """A folder that a dataset stage fills: its paths and its published version.

    `path` has no version in its name; a run holds `lock` while it fills the folder; `record` is None if none is
    published.
    """

    def __init__(self, directory: DataDirectory, name: str) -> None:
        self.directory, self.path, self.work = directory, directory.root / name, directory.work(name)
        self.record_path, self.lock = directory.folder_record(name), self.work / "lock"
        self.refresh()

    def refresh(self) -> None:
        """Read again what is published."""
        try:
            self.record: FolderRecord | None = read_record(self.record_path, FolderRecord)
        except StoreError:
            self.record = None

    def is_complete(self) -> bool:
        """Check that every file of the published folder exists."""
        return self.record is not None and self.record.files.keys() <= files_below(self.path.with_name(self.record.location)).keys()

    def is_sound(self) -> bool:
        """Check that the published folder holds what was written, by reading every file."""
        return self.record is not None and not changed_files(self.path.with_name(self.record.location), self.record.files)

    def target(self, record: FolderRecord) -> Location:
        """Return the path of the folder that is published with a record."""
        return self.record_path.with_name(versioned(self.record_path.stem, [record.key, record.files]))

    def commit(self, filled: Path, record: FolderRecord) -> Location:
        """Move a finished folder to its versioned name, unless a killed run has; publish its record, return its path.

        In object storage, a `StoreError` says that another run has published something meanwhile.
        """
        path, version = self.target(record), version_of(self.record_path)
        unmoved = filled if record.files.keys() <= files_below(filled).keys() else None
        _publish(self.directory, unmoved, path, self.record_path, record, {"location": path.name}, version)
        self.refresh()
        return path


def withdraw(record_path: Location) -> None:
    """Remove a record, so that its group is no longer found; current readers get the grace period."""
    if (location := named_location(record_path)) is not None:
        mark_replaced(record_path.with_name(location))
    remove(record_path)


def _publish(
    directory: DataDirectory,
    source: Path | None,
    path: Location,
    record_path: Location,
    record: Provenance,
    fields: Mapping[str, Any],
    version: str | None,
) -> None:
    """Move a group or folder, unless `source` is None, to its path, then publish its record with these fields, after validating it."""
    record = type(record).model_validate({**dict(record), **fields})
    if source is not None:
        move_folder(source, path)
    replaced = named_location(record_path)
    if replaced not in (None, path.name):
        mark_replaced(path.with_name(replaced))
    if not replace_version(record_path, serialise_with_checksum(record), version):
        raise StoreError(f"{record_path} was published by another run meanwhile; run again")
    if isinstance(path, Path):  # object storage has no locks: there, `vt-pipeline collect-garbage` does it
        collect(directory, path.parent)

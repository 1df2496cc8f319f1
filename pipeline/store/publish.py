"""Publish shards and folders: write under a name of their own, then let a record name them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipeline.errors import StoreError
from pipeline.store.atomic import move_folder, replace_version, version_of
from pipeline.store.directory import DataDirectory, shard_name, versioned
from pipeline.store.garbage import collect, note_replaced
from pipeline.store.record import FolderRecord, Provenance, R, ShardRecord, named_location, sealed
from pipeline.store.rows import Row
from pipeline.store.storage import Place, remove
from pipeline.store.write import RowToPack, metadata_digests, write_group
from schemas.base import Artifact


def publish_shard(
    directory: DataDirectory,
    artifact: Artifact,
    number: int,
    shards: int,
    record: ShardRecord,
    rows: Sequence[RowToPack],
    constants: Row,
    attributes: Mapping[str, Any],
) -> Place:
    """Write the group of a shard, and publish its record with the group's name in it; returns the group's path.

    Raises
    ------
    StoreError
        The group cannot be written as its schema says; or, in object storage, another run has published something meanwhile.
    """
    name = shard_name(number, shards)
    location = versioned(name, [record.key, [row.digest for row in record.rows]]) + ".zarr"
    path, record_path = directory.root / artifact.name / location, directory.shard_record(artifact.name, number, shards)
    version = version_of(record_path)
    with _workplace(directory.work(artifact.name)) as work:
        for unfinished in work.glob(f"{name}-*.zarr"):  # of a run that was killed
            shutil.rmtree(unfinished, ignore_errors=True)
        beside = work / location
        write_group(beside, artifact, rows, constants, attributes)
        written = {"location": location, "metadata": metadata_digests(beside, artifact)}
        _publish(directory, beside, path, record_path, _completed(record, written), version)
    return path


@contextmanager
def _workplace(work: Place) -> Iterator[Path]:
    """Give a folder on this machine's disk to write a group in: `work` itself, or for object storage a temporary one."""
    if isinstance(work, Path):
        yield work
    else:
        with tempfile.TemporaryDirectory(prefix="vt-pipeline-") as folder:
            yield Path(folder)


def publish_folder(directory: DataDirectory, name: str, beside: Path, record: FolderRecord) -> Place:
    """Move a finished folder to a name of its own, and publish its record; returns the folder's path.

    Raises
    ------
    StoreError
        In object storage: another run has published something meanwhile.
    """
    place = directory.folder_record(name)
    location = versioned(place.stem, [record.key, record.files])
    _publish(directory, beside, place.with_name(location), place, _completed(record, {"location": location}), version_of(place))
    return place.with_name(location)


def withdraw(record_path: Place) -> None:
    """Remove a record, so that nobody finds what it names; who reads that already is given time."""
    if (named := named_location(record_path)) is not None:
        note_replaced(record_path.with_name(named))
    remove(record_path)


def _completed(record: R, fields: Mapping[str, Any]) -> R:
    """Fill in what is known of an output when it is written, validated: what is published can be read."""
    return type(record).model_validate({**dict(record), **fields})


def _publish(directory: DataDirectory, beside: Path, path: Place, record_path: Place, record: Provenance, version: str | None) -> None:
    move_folder(beside, path)
    replaced = named_location(record_path)
    if replaced not in (None, path.name):
        note_replaced(path.with_name(replaced))
    if not replace_version(record_path, sealed(record), version):
        raise StoreError(f"{record_path} was published by another run meanwhile; run again")
    if isinstance(path, Path):  # object storage has no lock: there it is a command of its own
        collect(directory, path.parent)

"""Publish shards and folders: write under a name of their own, then let a record name them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.store.atomic import flush_folder, move_folder, write_at_once
from pipeline.store.directory import DataDirectory, shard_name, versioned
from pipeline.store.garbage import collect, named_location
from pipeline.store.record import FolderRecord, Provenance, R, ShardRecord, sealed
from pipeline.store.rows import Row
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
) -> Path:
    """Write the group of a shard, and publish its record with the group's name in it; returns the group's path."""
    name = shard_name(number, shards)
    location = versioned(name, [record.key, [row.digest for row in record.rows]]) + ".zarr"
    work, path = directory.work(artifact.name), directory.root / artifact.name / location
    for unfinished in work.glob(f"{name}-*.zarr"):  # of a run that was killed
        shutil.rmtree(unfinished, ignore_errors=True)
    beside = work / location
    write_group(beside, artifact, rows, constants, attributes)
    written = {"location": location, "metadata": metadata_digests(beside, artifact)}
    _publish(beside, path, directory.shard_record(artifact.name, number, shards), _completed(record, written))
    return path


def publish_folder(directory: DataDirectory, name: str, beside: Path, record: FolderRecord) -> Path:
    """Move a finished folder to a name of its own, and publish its record; returns the folder's path."""
    place = directory.folder_record(name)
    location = versioned(place.stem, [record.key, record.files])
    _publish(beside, place.with_name(location), place, _completed(record, {"location": location}))
    return place.with_name(location)


def _completed(record: R, fields: Mapping[str, Any]) -> R:
    """Fill in what is known of an output when it is written, validated: what is published can be read."""
    return type(record).model_validate({**dict(record), **fields})


def _publish(beside: Path, path: Path, record_path: Path, record: Provenance) -> None:
    flush_folder(beside)
    move_folder(beside, path)
    replaced = path.with_name(named_location(record_path) or path.name)
    if replaced.exists():
        os.utime(replaced)  # its readers are given time from now on, however old it is
    write_at_once(record_path, sealed(record))
    collect(path.parent)

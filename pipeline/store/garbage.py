"""Find and remove what no record names: groups and folders that were replaced, and what killed runs left."""

import fnmatch
import math
import os
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from pipeline.errors import StoreError
from pipeline.store.atomic import write_atomically
from pipeline.store.directory import SHARD_RECORD, WORK, DataDirectory, record_of
from pipeline.store.record import named_location
from pipeline.store.storage import TEMPORARY, Location, files_below, list_folder, remove, remove_files
from schemas.catalogue import ARTIFACTS
from schemas.folders import RECORD, TREES

GRACE_SECONDS = 3600.0  # how long a replaced group is kept: readers may still have it open

UNFINISHED_SECONDS = 7 * 86_400.0  # how long unfinished work is kept at least: the rows of a shard wait there until all of them are made

REPLACED = ".replaced"
"""A marker file written into a folder in object storage when the folder is replaced: its age counts as the folder's. A run that loses a
race may leave one in the current folder; it is hidden, and does no harm there."""

_UNFINISHED = re.compile(rf".+\.[0-9a-f]{{32}}{re.escape(TEMPORARY)}")  # names that `temporary` gives


def unreferenced(directory: DataDirectory, folder: Location, older_than: float = -math.inf) -> Iterator[Location]:
    """Find the groups and folders directly in a folder that no record names, and unfinished files.

    All other names are the user's. Only those are found that were replaced or written more than `older_than` seconds
    ago; the records of others are not read, so that a publication among thousands of shards reads few of them.
    """
    versions: dict[str, list[str]] = {}  # by the name of their record
    for name, is_folder in sorted(list_folder(folder).items()):
        if _UNFINISHED.fullmatch(name) or (name.endswith(TEMPORARY) and _is_ours(directory, folder, name.removesuffix(TEMPORARY))):
            if _age(folder / name) > older_than:
                yield folder / name
        elif is_folder and record_of(name) and (isinstance(folder, Path) or files_below(folder / name)):  # servers list empty ones
            versions.setdefault(record_of(name), []).append(name)
    records = list_folder(folder) if versions else {}  # after the versions were listed: a record that was published meanwhile is there
    for record, names in versions.items():
        has_record = records.get(record) is False  # neither missing nor a folder
        if has_record and len(names) == 1:
            continue  # the version that the record names
        expired = [name for name in names if _age(folder / name) > older_than]
        current = named_location(folder / record) if has_record and expired else None  # None: it is damaged, and may have named any
        for name in expired:
            if current not in (None, name) if has_record else _is_ours(directory, folder, name):
                yield folder / name


def _is_ours(directory: DataDirectory, folder: Location, name: str) -> bool:
    """Check whether a run gives a group or folder in this folder such a name."""
    record = record_of(name)
    if folder == directory.root:
        return RECORD.fullmatch(record) is not None
    if folder.parent == directory.root and folder.name not in TREES:  # an artifact's
        return fnmatch.fnmatch(record, SHARD_RECORD) and name.endswith(".zarr")
    return bool(record)


def collect(directory: DataDirectory, folder: Location, older_than: float = GRACE_SECONDS) -> list[Location]:
    """Remove and return what no record of a folder names and was replaced or written more than `older_than` s ago.

    If a symbolic link leads to the folder, nothing is removed: it may belong to somebody else.
    """
    if _link_to(directory, folder):
        return []
    expired = [*unreferenced(directory, folder, older_than)]
    for path in expired:
        remove(path)
    return expired


def _age(path: Location) -> float:
    """Return how long ago a path was written or replaced, s; minus infinity if it is gone."""
    if isinstance(path, Path):
        with suppress(FileNotFoundError):  # another run has renamed or removed it
            return time.time() - path.lstat().st_mtime
        return -math.inf
    return time.time() - max((file.written for file in files_below(path).values()), default=0.0)


def mark_replaced(path: Location) -> None:
    """Mark a folder as replaced now, so that its readers get the grace period, however old it is."""
    if not isinstance(path, Path):
        write_atomically(path / REPLACED, b"")
    elif path.exists():
        os.utime(path, follow_symlinks=False)


def collect_everything(directory: DataDirectory, older_than: float = GRACE_SECONDS) -> list[Location]:
    """Remove from a data directory what no record names and is older than `older_than`, s; return what was removed.

    This includes unfinished work of a week ago or earlier: in object storage all of it, for there a run removes only its
    own; on a disk the rows that a run had published when it was killed.
    """
    removed = [path for folder in directory.record_folders() for path in collect(directory, folder, older_than)]
    work, oldest = directory.root / WORK, max(older_than, UNFINISHED_SECONDS)
    expired = [name for name, file in files_below(work).items() if time.time() - file.written > oldest]
    if isinstance(work, Path):
        published = _published_rows(directory) if expired and not _link_to(directory, work) else set()
        expired = [name for name in expired if name in published]
        for name in expired:
            remove(work / name)
    else:
        remove_files(work, expired)
    return removed + [work / name for name in expired]


def _published_rows(directory: DataDirectory) -> set[str]:
    """Name the files, below the work folder, in which the published rows waited."""
    files: set[str] = set()
    for name in directory.artifact_names():
        with suppress(StoreError):  # a record is damaged
            shards = directory.collection(ARTIFACTS[name]).shards
            files |= {f"{name}/rows/{row.object_id}/{row.key}.row" for shard in shards for row in shard.record.rows}
    return files


def links(directory: DataDirectory) -> list[Path]:
    """List the symbolic links in a data directory that lead to folders with records: there, nothing is removed."""
    return sorted({link for folder in directory.record_folders() if (link := _link_to(directory, folder))})


def _link_to(directory: DataDirectory, folder: Location) -> Path | None:
    """Find the symbolic link in a data directory that leads to a folder of it, if any; the directory itself may be reached by one."""
    paths = [*reversed(folder.parents), folder] if isinstance(folder, Path) else []
    return next((path for path in paths if directory.root in path.parents and path.is_symlink()), None)


def all_unreferenced(directory: DataDirectory) -> list[Location]:
    """Find everything in a data directory that no record names."""
    return [path for folder in directory.record_folders() for path in unreferenced(directory, folder)]

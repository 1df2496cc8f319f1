"""Find and remove what no record names: groups and folders that were replaced, and what killed runs left."""

from __future__ import annotations

import fnmatch
import math
import os
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from pipeline.store.atomic import write_atomically
from pipeline.store.directory import SHARD_RECORD, WORK, DataDirectory, is_version, unversioned
from pipeline.store.record import named_location
from pipeline.store.storage import TEMPORARY, Place, files_below, list_folder, remove, remove_files
from schemas.folders import RECORD, TREES

GRACE_SECONDS = 3600.0
"""How long a replaced group is kept: readers may still have it open."""

UNFINISHED_SECONDS = 7 * 86_400.0
"""How long unfinished work in object storage is kept at least: the rows of a shard wait there until all of them are made."""

REPLACED = ".replaced"
"""A marker file written into a folder in object storage when the folder is replaced: its age counts as the folder's. A run that loses a
race may leave one in the current folder; it is hidden, and does no harm there."""

_UNFINISHED = re.compile(rf".+\.[0-9a-f]{{32}}{re.escape(TEMPORARY)}")
"""Names that `temporary` gives."""


def unreferenced(directory: DataDirectory, folder: Place, published: str | None = None) -> Iterator[Place]:
    """Find the groups and folders directly in a folder that no record names, and unfinished files; all other names are the user's.

    With `published`, the name of one record, no other record is read: of what has another record, nothing is found.
    """
    versions: list[str] = []
    for name, is_folder in sorted(list_folder(folder).items()):
        if _UNFINISHED.fullmatch(name) or (name.endswith(TEMPORARY) and _is_ours(directory, folder, name.removesuffix(TEMPORARY))):
            yield folder / name
        elif is_folder and is_version(name) and (isinstance(folder, Path) or files_below(folder / name)):  # some servers list empty folders
            versions.append(name)
    records = list_folder(folder) if versions else {}  # after the versions were listed: a record that was published meanwhile is there
    for name in versions:
        record = f"{unversioned(name)}.json"
        if records.get(record, True):  # missing, or a folder
            if _is_ours(directory, folder, name):
                yield folder / name
        elif published in (None, record) and named_location(folder / record) not in (None, name):  # a damaged one may have named it
            yield folder / name


def _is_ours(directory: DataDirectory, folder: Place, name: str) -> bool:
    """Check whether a group or folder has a name that is given in this folder, whether or not it has a record."""
    if not is_version(name):
        return False
    record = f"{unversioned(name)}.json"
    if folder == directory.root:
        return RECORD.fullmatch(record) is not None
    return folder.parent != directory.root or folder.name in TREES or (fnmatch.fnmatch(record, SHARD_RECORD) and name.endswith(".zarr"))


def collect(directory: DataDirectory, folder: Place, older_than: float = GRACE_SECONDS, *, published: str | None = None) -> list[Place]:
    """Remove what no record of a folder names, if it was replaced or written `older_than` seconds ago or earlier.

    If a symbolic link leads to the folder, nothing is removed: it may belong to somebody else. `published` is as in `unreferenced`.

    Returns
    -------
    What was removed.
    """
    if _link_to(directory, folder):
        return []
    expired = [path for path in unreferenced(directory, folder, published) if time.time() - _written(path) > older_than]
    for path in expired:
        remove(path)
    return expired


def _written(path: Place) -> float:
    """Return when a path was written or replaced, s since 1970; infinity if it is gone."""
    if isinstance(path, Path):
        with suppress(FileNotFoundError):  # another run has renamed or removed it
            return path.lstat().st_mtime
        return math.inf
    return max((file.written for file in files_below(path).values()), default=0.0)


def mark_replaced(path: Place) -> None:
    """Mark a folder as replaced now, so that its readers get the grace period, however old it is."""
    if not isinstance(path, Path):
        write_atomically(path / REPLACED, b"")
    elif path.exists():
        os.utime(path, follow_symlinks=False)


def collect_everything(directory: DataDirectory, older_than: float = GRACE_SECONDS) -> list[Place]:
    """Remove from a data directory what no record names and is older than `older_than`, s; return what was removed.

    In object storage, this includes unfinished work of a week ago or earlier: there, a run removes only its own.
    """
    removed = [path for folder in directory.record_folders() for path in collect(directory, folder, older_than)]
    work = directory.root / WORK
    if not isinstance(work, Path):
        expired = [name for name, file in files_below(work).items() if time.time() - file.written > max(older_than, UNFINISHED_SECONDS)]
        remove_files(work, expired)
        removed += [work / name for name in expired]
    return removed


def links(directory: DataDirectory) -> list[Path]:
    """List the symbolic links in a data directory that lead to folders with records: there, nothing is removed."""
    return sorted({link for folder in directory.record_folders() if (link := _link_to(directory, folder))})


def _link_to(directory: DataDirectory, folder: Place) -> Path | None:
    """Find the symbolic link in a data directory that leads to a folder of it, if any; the directory itself may be reached by one."""
    paths = [*reversed(folder.parents), folder] if isinstance(folder, Path) else []
    return next((path for path in paths if directory.root in path.parents and path.is_symlink()), None)


def all_unreferenced(directory: DataDirectory) -> list[Place]:
    """Find everything in a data directory that no record names."""
    return [path for folder in directory.record_folders() for path in unreferenced(directory, folder)]

"""Find and remove what no record names: groups and folders that were replaced, and what killed runs left."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from pipeline.store.atomic import write_atomically
from pipeline.store.directory import DESCRIPTION, WORK, DataDirectory, is_version
from pipeline.store.record import named_location
from pipeline.store.storage import TEMPORARY, Place, files_below, list_folder, remove, remove_files

GRACE_SECONDS = 3600.0
"""How long a group that was replaced is kept: readers that opened it may still be at work."""

REPLACED = ".replaced"
"""A file that is written into a folder in object storage when it is replaced: its age is the folder's. A run that loses a race may leave
one in the folder that has won; hidden, it does no harm there."""


def unreferenced(folder: Place) -> Iterator[Place]:
    """Find the groups and folders directly in a folder that none of its records names, and files that were never finished."""
    versions: list[str] = []
    for name, is_folder in sorted(list_folder(folder).items()):
        if name.endswith(TEMPORARY):
            yield folder / name
        elif is_folder and is_version(name) and (isinstance(folder, Path) or files_below(folder / name)):  # some servers list empty folders
            versions.append(name)
    locations: set[str | None] = set()  # read after the versions were listed: what is published meanwhile is named, or was not listed
    for name, is_folder in list_folder(folder).items():
        if name.endswith(".json") and name != DESCRIPTION and not is_folder:
            locations.add(named_location(folder / name))
    if None in locations:  # a damaged record may have named any of them
        return
    for name in versions:
        if name not in locations:
            yield folder / name


def collect(directory: DataDirectory, folder: Place, older_than: float = GRACE_SECONDS) -> list[Place]:
    """Remove what no record of a folder names, if it was replaced or written `older_than` seconds ago or earlier.

    If a symbolic link leads to the folder, nothing is removed: it may belong to somebody else.

    Returns
    -------
    What was removed.
    """
    if _link_to(directory, folder):
        return []
    expired = [path for path in unreferenced(folder) if time.time() - _written(path) > older_than]
    for path in expired:
        remove(path)
    return expired


def _written(path: Place) -> float:
    """When something was written, or replaced, s since 1970; never, where it is gone meanwhile."""
    if isinstance(path, Path):
        with suppress(FileNotFoundError):  # another run has renamed it, or removed it, too
            return path.lstat().st_mtime
        return math.inf
    return max((file.written for file in files_below(path).values()), default=0.0)


def mark_replaced(path: Place) -> None:
    """Note that a folder is replaced now: its readers are given time, however old it is."""
    if not isinstance(path, Path):
        write_atomically(path / REPLACED, b"")
    elif path.exists():
        os.utime(path, follow_symlinks=False)


def collect_everything(directory: DataDirectory, older_than: float = GRACE_SECONDS) -> list[Place]:
    """Remove from a data directory all that no record names and was replaced, or written, longer ago, s; returns what was removed.

    In object storage, what runs left half done goes too: there they remove only what is their own.
    """
    removed = [path for folder in directory.record_folders() for path in collect(directory, folder, older_than)]
    work = directory.root / WORK
    if not isinstance(work, Path):
        expired = [name for name, file in files_below(work).items() if time.time() - file.written > older_than]
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
    """Find all in a data directory that no record names."""
    return [path for folder in directory.record_folders() for path in unreferenced(folder)]

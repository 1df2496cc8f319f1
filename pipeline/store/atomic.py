"""Publish files and folders at once, with one writer at a time."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from pipeline.errors import StoreError

MACHINE_FAULTS = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE}
"""What the system says when a disk is full, a quota used up, a disk read-only or broken, or when too many files are open."""


TEMPORARY = ".tmp"
"""How the names of files end that are being written."""


def is_machine_fault(error: Exception) -> bool:
    """Whether an error is neither the object's nor ours, but that of the machine it was met on."""
    return isinstance(error, OSError) and error.errno in MACHINE_FAULTS


def write_at_once(path: Path, content: bytes) -> None:
    """Write a file so that readers see the old content or the new, never a part, whatever the machine does meanwhile."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary(path) as beside:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    flush(path.parent)


def flush(path: Path) -> None:
    """Let the disk have what was written of a file, or the names in a folder: a power cut takes neither."""
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def flush_folder(folder: Path) -> None:
    """Let the disk have a folder with everything in it."""
    for path in [*folder.rglob("*"), folder]:
        flush(path)


@contextmanager
def temporary(path: Path) -> Iterator[Path]:
    """Give the name of a file beside `path` to write and rename or link; whatever happens, nothing is left of it."""
    beside = path.with_name(f"{path.name}.{os.getpid()}{TEMPORARY}")
    try:
        yield beside
    finally:
        beside.unlink(missing_ok=True)


def move_folder(source: Path, target: Path) -> None:
    """Rename a folder; one that no record names may be in the way, left by a killed run, and is removed."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(target, ignore_errors=True)
    source.replace(target)
    flush(target.parent)


@contextmanager
def one_writer(lock: Path, what: Path) -> Iterator[None]:
    """Hold a lock; the system frees it however its holder ends.

    Raises
    ------
    StoreError
        Another run holds it.
    """
    lock.parent.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(lock, timeout=0):
            yield
    except Timeout:
        raise StoreError(f"{what} is being made by another run; wait for it to end") from None

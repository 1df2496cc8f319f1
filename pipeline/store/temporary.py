"""Temporary folders that other users cannot read; those of a killed process are removed by the next one."""

import fcntl
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

PREFIX = "of-process-"


def private_folder(parent: str | Path | None = None) -> Path:
    """Make a folder for temporary files that only this user can read or write; the next run finds it again.

    Dask has Python look for modules there first, and clears the files that killed workers leave in it.
    """
    parent = Path(parent or tempfile.gettempdir())
    folder = parent / f"vt-pipeline-{os.getuid()}"
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700, parents=True)
    status = folder.lstat()
    if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not stat.S_IMODE(status.st_mode) & 0o077:
        return folder
    return Path(tempfile.mkdtemp(prefix="vt-pipeline-", dir=parent))  # another user has taken the name


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield an empty folder that is removed at the end; those of killed processes are removed at the start.

    A process holds a lock on each of its folders: a folder without one belongs to nobody.
    """
    parent = private_folder()
    with _locked(parent):
        for leftover in parent.glob(f"{PREFIX}*"):
            with suppress(OSError), _locked(leftover, wait=False):
                shutil.rmtree(leftover, ignore_errors=True)
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
        lock = ExitStack()
        lock.enter_context(_locked(folder))
    with lock:
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _locked(folder: Path, *, wait: bool = True) -> Iterator[None]:
    """Hold the lock of a folder; without `wait`, raise a `BlockingIOError` if another process holds it."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield
    finally:
        os.close(descriptor)

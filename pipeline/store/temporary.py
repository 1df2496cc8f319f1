"""Temporary folders that other users cannot read, local copies of folders in object storage, and temporary environment variables."""

import fcntl
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Event, Thread

from obstore.exceptions import BaseError

from pipeline.store.storage import TEMPORARY, File, Location, cache_of, copy, files_below

PREFIX = "of-process-"


def private_folder() -> Path:
    """Make a folder for temporary files that only this user can read or write; the next run finds it again."""
    parent = Path(tempfile.gettempdir())
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


SECONDS = 30.0  # seconds between two checks for changed files: the most work that is lost with a machine


@contextmanager
def local_copy(folder: Location, *, begin: bool = True, send: bool = False) -> Iterator[Path]:
    """Yield a local folder to work in: `folder` itself if it is on a disk, else a copy.

    If `begin`, the copy starts with the files of `folder`, and is kept for the next run; else it starts empty and is
    removed at the end. If `send`, files are sent to `folder` as they change, so that a killed run can continue, on
    another machine too. A run that ends without an error has published its files: they are not sent again.
    """
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
        return
    if not begin:
        with temporary_folder() as empty:
            yield empty
        return
    local = cache_of(folder)
    local.mkdir(parents=True, exist_ok=True)
    cached = files_below(local)
    newer = [name for name, file in files_below(folder).items() if name not in cached or file.written > cached[name].written]
    copy(folder, local, newer)
    if not send:
        yield local
        return
    copied = files_below(local)
    sent, ended = {name: copied[name] for name in newer}, Event()  # a killed run may not have sent the others

    def send_until_ended() -> None:
        while not ended.wait(SECONDS):
            with suppress(BaseError, OSError):  # tried again, the last time with its error
                _send_changed(local, folder, sent)

    sender = Thread(target=send_until_ended, daemon=True)
    sender.start()
    unfinished = True
    try:
        yield local
        unfinished = False
    finally:
        ended.set()
        sender.join()
        if unfinished:
            _send_changed(local, folder, sent)


def _send_changed(local: Path, folder: Location, sent: dict[str, File]) -> None:
    """Copy the files that have changed since they were sent."""
    files = {name: file for name, file in files_below(local).items() if not name.endswith(TEMPORARY)}
    changed = [name for name, file in files.items() if sent.get(name) != file]
    copy(local, folder, changed)
    sent.update({name: files[name] for name in changed})


@contextmanager
def environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Change environment variables for a moment: a process that is started meanwhile inherits them."""
    before = {name: os.environ[name] for name in changes.keys() & os.environ.keys()}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name in changes:
            del os.environ[name]
        os.environ.update(before)

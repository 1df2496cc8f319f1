"""Copies of folders in object storage on this machine's disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread

from obstore.exceptions import BaseError

from pipeline.store.storage import TEMPORARY, File, Place, cache_of, copy, files_below
from pipeline.store.temporary import temporary_folder

SECONDS = 30.0
"""Between two looks at what has changed: what a machine that is lost takes with it at most."""


@contextmanager
def local_copy(folder: Place, *, begin: bool = True, send: bool = False) -> Iterator[Path]:
    """Give a folder on this machine's disk to work in: `folder` itself where it is on one, else a copy.

    Parameters
    ----------
    folder
        On a disk, or in object storage.
    begin
        Begin with the files that are there, and keep the copy for the next run; else the copy is empty, and removed at the end.
    send
        Send files to `folder` as they change: a run that is killed goes on from there, on another machine too; the copy of one
        that ends without an error has been published, and is not sent once more.
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
    sent, ended = {name: copied[name] for name in newer}, Event()  # the others have changed since a killed run sent them, if it did

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


def _send_changed(local: Path, folder: Place, sent: dict[str, File]) -> None:
    """Copy the files that have changed since they were sent."""
    files = {name: file for name, file in files_below(local).items() if not name.endswith(TEMPORARY)}
    changed = [name for name, file in files.items() if sent.get(name) != file]
    copy(local, folder, changed)
    sent.update({name: files[name] for name in changed})

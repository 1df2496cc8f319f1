"""A work folder on this machine's disk whose files are brought to object storage as they change."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread

from obstore.exceptions import BaseError

from pipeline.store.storage import TEMPORARY, File, Place, cache_of, copy, files_below

SECONDS = 30.0
"""Between two looks at what has changed: what a machine that is lost takes with it at most."""


@contextmanager
def mirrored(folder: Place, *, send: bool = True) -> Iterator[Path]:
    """Give a folder to work in: `folder` itself on a disk, else one on this machine's disk that begins and stays like it.

    A run that is killed goes on from it, on another machine too. What ends without an error has been published, and is not sent once more.
    Without `send` the folder only begins like the other one.
    """
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
        return
    local = cache_of(folder)
    local.mkdir(parents=True, exist_ok=True)
    here = files_below(local)
    copy(folder, local, [name for name, file in files_below(folder).items() if name not in here or file.written > here[name].written])
    if not send:
        yield local
        return
    sent, ended = files_below(local), Event()

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
    there = {name: file for name, file in files_below(local).items() if not name.endswith(TEMPORARY)}
    changed = [name for name, file in there.items() if sent.get(name) != file]
    copy(local, folder, changed)
    sent.update({name: there[name] for name in changed})

"""Putting finished things in place at once, and one writer at a time."""

from __future__ import annotations

import fcntl
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import StoreError


def put_in_place(beside: Path, path: Path) -> None:
    """Put a directory under its name in place of what stood there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    old = beside.with_name(f"{path.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    if path.exists():
        path.replace(old)
    beside.replace(path)
    shutil.rmtree(old, ignore_errors=True)


@contextmanager
def one_writer(lock: Path, path: Path, wait: bool = False) -> Iterator[None]:
    """Hold the lock of `path`: the system frees it however its holder ends; a `StoreError` where another run holds it, or wait."""
    lock.parent.mkdir(parents=True, exist_ok=True)
    with lock.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise StoreError(f"{path} is being made by another run; wait for it to end") from None
        yield

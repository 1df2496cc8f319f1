"""Publish files and folders atomically: by renaming on a disk, by conditional puts in object storage."""

import errno
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import obstore
from filelock import FileLock, Timeout
from obstore.exceptions import AlreadyExistsError, GenericError, PreconditionError

from pipeline.errors import StoreError, first_line
from pipeline.store.storage import (
    TEMPORARY,
    Location,
    bucket_of,
    cache_of,
    copy,
    files_below,
    key_of,
    read_bytes,
    remove_files,
    temporary,
    wait_before_retry,
)
from pipeline.store.temporary import local_copy

ATTEMPTS = 12  # at a conditional put while no other process writes: storage may refuse one in a race, or a connection break


UNFINISHED = ".unfinished"  # the subfolder of a target folder that holds unfinished files and the lock of their writer


def write_atomically(path: Location, content: bytes, *, durable: bool = True) -> None:
    """Write a file so that readers see the old content or the new, never a part; if `durable`, a power cut loses neither.

    A symbolic link at `path` is replaced; its target does not change.
    """
    if not isinstance(path, Path):
        obstore.put(bucket_of(path), key_of(path), content)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with name_in_errors(path), temporary(path) as temporary_file:
        with temporary_file.open("wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        temporary_file.replace(path)
    if durable:
        flush([path.parent])


@contextmanager
def atomic_writes(folder: Location) -> Iterator[Path]:
    """Yield an empty local folder to write files in; at the end each file is moved into `folder` atomically.

    `folder` may be a symbolic link; links below it are refused. Files of a killed writer are removed. A failed one
    leaves no empty folder.
    """
    if not isinstance(folder, Path):
        with local_copy(folder, begin=False) as local, name_in_errors(local):
            yield local
            copy(local, folder, files_below(local))
        return
    work, new_files, existed = folder / UNFINISHED, folder / UNFINISHED / "files", folder.exists()
    refuse_links(folder, [f"{UNFINISHED}/lock", f"{UNFINISHED}/files"])
    with name_in_errors(folder), exclusive_lock(work / "lock", folder):
        try:
            shutil.rmtree(new_files, ignore_errors=True)
            new_files.mkdir()
            yield new_files
            move_files(new_files, folder)
        finally:
            shutil.rmtree(work, ignore_errors=True)
            if not existed:
                with suppress(OSError):  # it holds files, unless writing them failed
                    folder.rmdir()


def move_files(source: Path, folder: Path) -> None:
    """Move the files below a folder into another one on the same disk, each atomically."""
    names = sorted(files_below(source))
    refuse_links(folder, names)
    flush([*source.rglob("*"), source])
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).replace(folder / name)
    flush({(folder / name).parent for name in names})


def refuse_links(folder: Path, names: Iterable[str]) -> None:
    """Raise a `StoreError` if the path of a file below a folder contains a symbolic link; the folder itself may be one."""
    paths = {path for name in names for path in (Path(name), *Path(name).parents[:-1])}
    if link := next((folder / path for path in sorted(paths) if (folder / path).is_symlink()), None):
        raise StoreError(f"{link} is a symbolic link to {os.readlink(link)}; nothing is written through links: remove it, then run again")


@contextmanager
def name_in_errors(path: Path) -> Iterator[None]:
    """Add a path to OS errors that name none, such as that of a full disk."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.strerror:
            error.filename = str(path)
        raise


def version_of(path: Location) -> str | None:
    """Read the ETag of a file in object storage; None for a missing file, and on a disk, where locks are used."""
    if isinstance(path, Path):
        return None
    try:
        return obstore.head(bucket_of(path), key_of(path))["e_tag"]
    except FileNotFoundError:
        return None


def replace_version(
    path: Location,
    content: bytes,
    version: str | None,  # the current one, of `version_of`; ignored on a disk
) -> bool:
    """Replace a file atomically, in object storage only if nobody else has written it; say whether it has the content.

    The response to a put may be lost, and its retry refused because the first one succeeded: the content is compared
    afterwards.
    """
    if isinstance(path, Path):
        write_atomically(path, content)
        return True
    mode: Any = "create" if version is None else {"e_tag": version}
    reason = ""
    for attempt in range(ATTEMPTS):
        try:
            obstore.put(bucket_of(path), key_of(path), content, mode=mode)
            return True
        except (AlreadyExistsError, PreconditionError, GenericError) as error:
            if (current := version_of(path)) is not None and read_bytes(path) == content:
                return True
            if current != version:
                return False
            reason = first_line(error)
            wait_before_retry(attempt)
    raise StoreError(f"{path} cannot be written: each of {ATTEMPTS} conditional puts failed, though nobody else wrote: {reason}")


def create(path: Location, content: bytes) -> None:
    """Write a file atomically, unless it exists."""
    if not isinstance(path, Path):
        replace_version(path, content, None)
        return
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary(path) as temporary_file, suppress(FileExistsError):
        temporary_file.write_bytes(content)
        try:
            os.link(temporary_file, path)
        except OSError as error:
            if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS):
                raise
            with path.open("xb") as file:  # the file system has no links: exFAT, some shares
                file.write(content)


def flush(paths: Iterable[Path]) -> None:
    """Flush the content of files, and the entries of folders, to the disk."""
    for path in paths:
        opened = os.open(path, os.O_RDONLY)
        try:
            os.fsync(opened)
        finally:
            os.close(opened)


def move_folder(source: Path, target: Location) -> None:
    """Move a local folder to its published path, and replace what is there; on a disk, the source is gone afterwards.

    The target may be what a killed run left, or the same rows, computed before: readers see it until it is replaced.
    """
    if not isinstance(target, Path):
        names = files_below(source).keys()
        copy(source, target, names)
        if superfluous := files_below(target).keys() - names:
            remove_files(target, superfluous)
        return
    flush([*source.rglob("*"), source])
    target.parent.mkdir(parents=True, exist_ok=True)
    previous = target.with_name(target.name + TEMPORARY)
    shutil.rmtree(previous, ignore_errors=True)
    with suppress(FileNotFoundError):
        target.replace(previous)
    try:
        source.replace(target)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        beside = target.with_name(f"{target.name}.{uuid.uuid4().hex}{TEMPORARY}")  # a symbolic link leads to another disk
        shutil.copytree(source, beside)
        flush([*beside.rglob("*"), beside])
        beside.replace(target)
        shutil.rmtree(source)
    flush([target.parent])
    shutil.rmtree(previous, ignore_errors=True)


@contextmanager
def exclusive_lock(lock: Location, what: Location) -> Iterator[None]:
    """Hold a lock, or raise a `StoreError` if another run holds it; the system releases it however its holder ends.

    Object storage has no locks: there, only runs on the same machine exclude each other. Of two others that compute the
    same output, one publishes first, and both have written the same.
    """
    lock_file = lock if isinstance(lock, Path) else cache_of(lock)
    lock_file.parent.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(lock_file, timeout=0):
            yield
    except Timeout:
        raise StoreError(f"{what} is being made by another run; wait for it to end") from None

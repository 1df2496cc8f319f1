"""Locations of data: folders on a disk, or prefixes in object storage. Most differences between the two are here, others in `atomic.py`.

Credentials, region and endpoint of object storage come from the environment: `AWS_ACCESS_KEY_ID`, `AWS_ENDPOINT_URL`, ….
"""

import errno
import hashlib
import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from itertools import count
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar
from uuid import uuid4

import obstore
from obstore.exceptions import BaseError, GenericError
from obstore.store import ObjectStore, from_url
from upath import UPath

from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.file_content import POINTER_REMEDY, expanded, is_pointer, is_pointer_file, regular_stat

PROTOCOLS = ("s3", "gs")  # URL schemes of object storage with conditional puts: S3 and compatible servers, Google Cloud Storage
THREADS = 16  # concurrent requests: each waits for the network, not for a core
NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}  # error codes of a full disk or an exhausted quota

MACHINE_FAULTS = NO_ROOM | {errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE}
"""Error codes of a full, read-only or broken disk, and of too many open files."""

RETRY: Any = {"max_retries": 10_000, "retry_timeout": timedelta(minutes=3)}
"""Retries of a request that a server does not answer, or answers with 5xx: it may be restarting."""

Location = Path | UPath  # a folder or file: `pathlib.Path` on a disk, `UPath` in object storage
TEMPORARY = ".tmp"  # suffix of files that are being written

A = TypeVar("A")
B = TypeVar("B")


@dataclass(frozen=True)
class File:
    """A stored file: its size, and when it was written, s since 1970."""

    bytes: int
    written: float


def as_location(text: str | Location) -> Location:
    """Convert a path or URL to a location; refuse an empty one, and a URL of no object storage that can be written to."""
    if not str(text):
        raise InvalidInput("the name of a data directory is empty; name a folder, or object storage")
    protocol, separator, rest = str(text).partition("://")
    if not separator:
        return expanded(str(text))
    if protocol not in PROTOCOLS or not rest.strip("/"):
        raise InvalidInput(f"{text} cannot hold data; give a folder, or {' or '.join(f'{name}://BUCKET/PREFIX' for name in PROTOCOLS)}")
    return UPath(f"{protocol}://{'/'.join(filter(None, rest.split('/')))}")


def is_machine_fault(error: Exception) -> bool:
    """Check whether an error is a fault of the machine or the object storage, not of an object or of this project."""
    return isinstance(error, BaseError) or (isinstance(error, OSError) and error.errno in MACHINE_FAULTS)


def read_bytes(path: Location) -> bytes:
    """Read a regular file; raise a `FileNotFoundError` if there is none, a `StoreError` if it is a Git LFS pointer."""
    if isinstance(path, Path):
        regular_stat(path)
        content = path.read_bytes()
    else:
        content = bytes(obstore.get(bucket_of(path), key_of(path)).bytes())
    if is_pointer(content):
        raise StoreError(f"{path} is {POINTER_REMEDY}")
    return content


def check_file(path: Path | str) -> None:
    """Raise a `StoreError` if a file on a disk is a Git LFS pointer or not a regular one, a `FileNotFoundError` if there is none."""
    regular_stat(path)
    if is_pointer_file(path):
        raise StoreError(f"{path} is {POINTER_REMEDY}")


def exists(path: Location) -> bool:
    """Check whether a file exists; object storage has no folders."""
    if isinstance(path, Path):
        return path.is_file()
    try:
        obstore.head(bucket_of(path), key_of(path))
    except FileNotFoundError:
        return False
    return True


def on_disk(path: Location) -> Path | None:
    """Return a location on this machine's disk as it is; None for one in object storage."""
    return path if isinstance(path, Path) else None


def list_folder(folder: Location) -> dict[str, bool]:
    """List the entries of a folder: by name, whether each is a folder; empty if there is no such folder."""
    if isinstance(folder, Path):
        if not folder.is_dir():
            return {}
        with os.scandir(folder) as entries:
            return {entry.name: os.path.isdir(entry) if entry.is_symlink() else entry.is_dir() for entry in entries}  # a link may loop
    listing = obstore.list_with_delimiter(bucket_of(folder), f"{key_of(folder)}/")
    files = {PurePosixPath(file["path"]).name: False for file in listing["objects"]}
    return files | {PurePosixPath(prefix).name: True for prefix in listing["common_prefixes"]}


def files_below(folder: Location) -> dict[str, File]:
    """List all files below a folder, by their path below it; empty if there is no such folder."""
    if isinstance(folder, Path):
        files: dict[str, File] = {}
        for parent, _, names in os.walk(folder):
            for path in map(Path(parent).joinpath, names):
                name = path.relative_to(folder).as_posix()
                with suppress(FileNotFoundError):  # it was removed since it was listed
                    try:
                        stat = path.stat()
                        files[name] = File(stat.st_size, stat.st_mtime)
                    except OSError:  # a link to nothing, or to itself
                        files[name] = File(0, path.lstat().st_mtime)
        return files
    return {name: File(int(entry["size"]), entry["last_modified"].timestamp()) for name, entry in _listed(folder)}


def _listed(folder: UPath) -> Iterator[tuple[str, Any]]:
    prefix = f"{key_of(folder)}/"
    for part in obstore.list(bucket_of(folder), prefix=prefix):
        yield from ((entry["path"].removeprefix(prefix), entry) for entry in part)


def remove(folder: Location) -> None:
    """Remove a file, or a folder with everything in it, if it exists; of a symbolic link, only the link."""
    if not isinstance(folder, Path):
        remove_files(folder, [*files_below(folder), ""])
    elif folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder, ignore_errors=True)
    else:
        folder.unlink(missing_ok=True)


def remove_files(folder: UPath, names: Iterable[str]) -> None:
    """Remove files below a folder in object storage, given by their paths below it; "" is the folder's own name."""
    keys = [f"{key_of(folder)}/{name}".removesuffix("/") for name in names]
    deadline = time.monotonic() + RETRY["retry_timeout"].total_seconds()
    for attempt in count() if keys else ():
        try:
            obstore.delete(bucket_of(folder), keys)
            break
        except GenericError:  # the connection broke: the client cannot know that a retry does no harm
            if time.monotonic() > deadline:
                raise
            wait_before_retry(attempt)


def wait_before_retry(attempt: int) -> None:
    """Wait before a request is repeated, longer each time, up to 3 s."""
    time.sleep(0.05 * 2 ** min(attempt, 6))


@contextmanager
def temporary(path: Path) -> Iterator[Path]:
    """Yield a unique path beside `path` for a file to write and then rename or link; it is removed at the end."""
    temporary_file = path.with_name(f"{path.name}.{uuid4().hex}{TEMPORARY}")  # processes in containers have equal numbers
    try:
        yield temporary_file
    finally:
        temporary_file.unlink(missing_ok=True)


def cache_of(folder: Location) -> Path:
    """Return the local folder, below `XDG_CACHE_HOME`, that caches a folder in object storage."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vt-pipeline"
    return cache / hashlib.sha256(str(folder.parent).encode()).hexdigest()[:16] / folder.name


def copy(source: Location, target: Location, names: Iterable[str]) -> None:
    """Copy files, given by their paths below `source`, from a disk to object storage, or from there to a disk."""

    def copy_file(name: str) -> None:
        original, path = source / name, target / name
        if isinstance(original, Path):
            obstore.put(bucket_of(path), key_of(path), original)
            return
        assert isinstance(path, Path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary(path) as temporary_file:
            with temporary_file.open("wb") as file:
                for part in obstore.get(bucket_of(original), key_of(original)).stream():
                    file.write(part)
            temporary_file.replace(path)

    map_in_threads(copy_file, list(names))


def map_in_threads(function: Callable[[A], B], items: Sequence[A]) -> list[B]:
    """Call a function that waits for the network with each item, several at a time; paths on a disk need no threads."""
    if all(isinstance(item, Path) for item in items):
        return [function(item) for item in items]  # where memory is short, a thread may end before it says so
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(function, items))


def bucket_of(path: Location) -> ObjectStore:
    """Return the client of the bucket of a location."""
    protocol, _, rest = str(path).partition("://")
    return client_of(f"{protocol}://{rest.partition('/')[0]}")


def key_of(path: Location) -> str:
    """Return the name of a location in its bucket."""
    return str(path).partition("://")[2].partition("/")[2]


@lru_cache(maxsize=64)
def client_of(url: str) -> ObjectStore:
    """Make the client of a bucket, or of a prefix in it."""
    client: ObjectStore = from_url(url, retry_config=RETRY)
    return client

"""The files of a group as Zarr reads them. Import this module where it is needed: Zarr takes a third of a second to import."""

import errno
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from zarr import Array
from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore, StorePath, WrapperStore
from zarr.storage import ObjectStore as ZarrObjectStore

from pipeline.store.storage import Location, check_file, client_of

ZARR_METADATA = ("zarr.json", ".zarray", ".zattrs", ".zgroup", ".zmetadata")
"""Files that Zarr looks for and that need not be there; all others that it reads are chunks."""


class _Files(WrapperStore[Store]):
    """The files of a group that Zarr reads: only regular ones are opened, and a missing chunk is an error."""

    def __init__(self, store: Store) -> None:
        super().__init__(store)
        self._folder = str(store.root) if isinstance(store, LocalStore) else None

    async def get(self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None) -> Buffer | None:
        if self._folder:
            with suppress(FileNotFoundError, NotADirectoryError):
                check_file(f"{self._folder}/{key}")
        content = await self._store.get(key, prototype, byte_range)
        if content is None and PurePosixPath(key).name not in ZARR_METADATA:
            raise FileNotFoundError(errno.ENOENT, "the chunk is missing", key)
        return content


def zarr_store(path: Location) -> Store:
    """Open a group for Zarr; a missing chunk is a `FileNotFoundError`."""
    files = LocalStore(path, read_only=True) if isinstance(path, Path) else ZarrObjectStore(client_of(str(path)), read_only=True)
    return _Files(files)


def open_array(group: Location, name: str, metadata: dict[str, Any]) -> Array[Any]:
    """Open an array of a group, whose `zarr.json` has been read."""
    return Array.from_dict(StorePath(zarr_store(group), name), metadata)

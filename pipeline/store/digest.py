"""Digests: hashes of computed content, which timings, versions, shards and workers do not change."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from pipeline.store.storage import Location, files_below, read_bytes

LOGS = "tensorboard"  # a subfolder that no digest covers, because it holds times of day


def of_json(value: Any) -> str:
    """Compute the SHA-256 of a JSON value, independent of the order of its keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()).hexdigest()


def of_arrays(arrays: Mapping[str, np.ndarray], **attributes: Any) -> str:
    """Compute the SHA-256 of named arrays (names, dtypes, shapes, values) and JSON attributes, independent of their order."""
    digest = hashlib.sha256(of_json(attributes).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        if array.dtype.kind in "OUT":  # strings, of any numpy type
            digest.update(f"{name}\0string\0{of_json(array.tolist())}".encode())
            continue
        digest.update(f"{name}\0{array.dtype.str}\0{array.shape}\0".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def of_rows(rows: Iterable[tuple[str, str]], header: Mapping[str, Any]) -> str:
    """Compute the digest of a whole artifact from its (object id, row digest) pairs and what all its shards share."""
    return of_json({"header": dict(header), "rows": sorted(rows)})


def files_of(folder: Location) -> list[str]:
    """List the files below a folder that its digest covers: all but logs and hidden ones."""
    return [name for name in sorted(files_below(folder)) if not name.startswith(f"{LOGS}/") and not is_hidden(name)]


def is_hidden(name: str) -> bool:
    """Check whether a file or one of its folders is hidden, as system files (`.DS_Store`, `.nfs…`) and checkpoints are."""
    return any(part.startswith(".") for part in name.split("/"))


def hashes_of(folder: Location, names: Iterable[str] | None = None) -> dict[str, str]:
    """Compute the SHA-256 of files below a folder, by default of all that its digest covers; a missing file has none."""
    hashes = {}
    for name in files_of(folder) if names is None else names:
        with suppress(FileNotFoundError, IsADirectoryError, NotADirectoryError):
            hashes[name] = hashlib.sha256(read_bytes(folder / name)).hexdigest()
    return hashes

"""Digests: what was computed, as a hash that timings, versions, shards and workers do not change."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np


def of_json(value: Any) -> str:
    """The SHA-256 of a JSON value, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()).hexdigest()


def of_arrays(arrays: Mapping[str, np.ndarray], **attributes: Any) -> str:
    """The SHA-256 of named arrays (names, dtypes, shapes, values) and JSON attributes, whatever their order."""
    digest = hashlib.sha256(of_json(attributes).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        if array.dtype.kind in "OUT":  # strings, whatever numpy keeps them in
            digest.update(f"{name}\0string\0{of_json(array.tolist())}".encode())
            continue
        digest.update(f"{name}\0{array.dtype.str}\0{array.shape}\0".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def of_rows(rows: Iterable[tuple[str, str]], header: Mapping[str, Any]) -> str:
    """The digest of a whole artifact from its (object id, row digest) pairs and what all its shards share."""
    return of_json({"header": dict(header), "rows": sorted(rows)})

"""Is a shard what its schema and its own digests say? Every way in which it is not, a line each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic_zarr.v3 import GroupSpec

from pipeline.store import digest
from pipeline.store.layout import Layout
from pipeline.store.shard import Shard, StoreError, row_digest
from pipeline.store.spec import departures
from schemas.base import COMMON, Artifact
from schemas.catalogue import ARTIFACTS

_ATTRIBUTES = ("digests", "object_keys", "failures", "constants_digest", "key", "settings", "seed", "manifest", "versions")


def problems(path: Path, artifact: Artifact) -> list[str]:
    """Everything wrong with the shard at `path`: array and reason, a line each; empty when it is whole and valid.

    Structure first (arrays, dtypes, dimensions, attributes); where that is right, every value is read: finite where
    the schema promises it, and equal to what was written, by digest.
    """
    try:
        shard = Shard(path, artifact)
    except StoreError as error:
        return [str(error)]
    try:
        found = list(departures(artifact, GroupSpec.from_zarr(shard.group)))
    except (ValueError, KeyError, FileNotFoundError) as error:
        return [f"metadata cannot be read: {error}"]
    found += [f"attribute {name} is missing" for name in _ATTRIBUTES if name not in shard.attributes]
    return found or _wrong_values(shard)


def _wrong_values(shard: Shard) -> list[str]:
    found = []
    arrays = shard.artifact.arrays
    names = [name for name in arrays if name in shard.group]
    damaged = [line for name in names if (line := _unreadable(shard, name))]
    if damaged:
        return damaged
    constants = {name: np.asarray(shard.array(name)[...]) for name in names if not arrays[name].per_object}
    if digest.of_arrays(constants) != shard.attributes["constants_digest"]:
        found.append(f"{', '.join(constants)}: differs from what was written (digest)")
    for row, object_id in enumerate(shard.object_ids):
        failure = shard.failure(object_id)
        if bool(shard.array("ok")[row]) == (failure is not None):
            found.append(f"ok: {object_id} is {not failure} by its recorded failures, the array says otherwise")
        try:
            values = {name: value for name, value in shard.view(object_id).items() if name not in COMMON}
        except Exception as error:  # whatever a codec raises on bytes that changed
            found.append(f"{object_id}: cannot be read: {error}")
            continue
        found += [f"{name}: {object_id} holds NaN" for name, value in values.items() if _nan(value)]
        if row_digest(values, failure) != shard.row_digest(object_id):
            found.append(f"{object_id}: its arrays differ from what was written (digest); delete {shard.path} and run again")
    return found


def _nan(value: np.ndarray) -> bool:
    return value.dtype.kind == "f" and bool(np.isnan(value).any())


def _unreadable(shard: Shard, name: str) -> str | None:
    """Why an array cannot be read, if it cannot: a codec's checksum finds every flipped bit."""
    array = shard.array(name)
    declared = shard.artifact.arrays[name]
    for row in range(array.shape[0]) if declared.per_object else (...,):
        try:
            value = np.asarray(array[row])
        except Exception as error:  # whatever a codec raises on bytes that changed
            where = f" of {shard.object_ids[row]}" if isinstance(row, int) and name != "object_id" else ""
            return f"{name}{where}: a chunk is damaged: {error}"
        if value.dtype.kind == "f" and not declared.infinite and not np.isfinite(value).all() and not _nan(value):
            return f"{name}: row {row} holds an infinite value"
    return None


def problems_below(path: Path) -> dict[Path, list[str]]:
    """The problems of the shard at `path`, or of every shard of the data directory there, by path."""
    if path.suffix == ".zarr":
        shards = [path]
    else:
        layout = Layout(path)
        shards = [shard for name in layout.artifacts() for _, shard in layout.shards(name)]
    return {shard: _problems_by_folder(shard) for shard in shards}


def _problems_by_folder(path: Path) -> list[str]:
    artifact = ARTIFACTS.get(path.resolve().parent.name)
    if artifact is None:
        return [f"its folder is called {path.resolve().parent.name}; known artifacts are {', '.join(ARTIFACTS)}"]
    return problems(path, artifact)

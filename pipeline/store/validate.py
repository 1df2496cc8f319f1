"""Are shards and models what their schemas and their own digests say? Every way in which one is not, a line each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic_zarr.v3 import GroupSpec

from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from pipeline.store.record import Record, folders, standing_record
from pipeline.store.shard import Shard, row_digest
from pipeline.store.spec import departures
from schemas.base import COMMON, Artifact
from schemas.catalogue import ARTIFACTS

_ATTRIBUTES = (
    "digests",
    "object_keys",
    "input_digests",
    "failures",
    "shard",
    "shards",
    "constants_digest",
    "key",
    "settings",
    "seed",
    "manifest",
    "versions",
)


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
    try:
        return found or _wrong_values(shard)
    except StoreError as error:
        return [str(error)]


def _wrong_values(shard: Shard) -> list[str]:
    found = []
    arrays = shard.artifact.arrays
    names = [name for name in arrays if shard.has(name)]
    damaged = [line for name in names if (line := _unreadable(shard, name))]
    if damaged:
        return damaged
    constants = {name: np.asarray(shard.array(name)[...]) for name in names if not arrays[name].per_object}
    if digest.of_arrays(constants) != shard.attributes["constants_digest"]:
        found.append(f"{', '.join(constants)}: differs from what was written (digest)")
    if len(shard.attributes["digests"]) != len(shard.object_ids):
        return [*found, f"attribute digests has {len(shard.attributes['digests'])} entries for {len(shard.object_ids)} objects"]
    for row, object_id in enumerate(shard.object_ids):
        failure = shard.failure(object_id)
        if bool(shard.array("ok")[row]) == (failure is not None):
            found.append(f"ok: {object_id} is {not failure} by its recorded failures, the array says otherwise")
        found += _wrong_row(shard, object_id)
    return found


def _wrong_row(shard: Shard, object_id: str) -> list[str]:
    view, failure = shard.view(object_id), shard.failure(object_id)
    names = [name for name in view if name not in COMMON]
    needed = [name for name in shard.artifact.ragged if "*" not in name] if failure is None else []
    if missing := [f"{name}: the array of {object_id} is missing" for name in needed if name not in names]:
        return missing
    values, found = {}, []
    for name in names:
        try:
            values[name] = view[name]
        except Exception as error:  # whatever a codec raises on bytes that changed
            return [f"{name}: a chunk of {object_id} is damaged: {error}"]
        if _nan(values[name]):
            found.append(f"{name}: {object_id} holds NaN")
    if row_digest(values, failure, str(view["category"])) != shard.row_digest(object_id):
        found.append(f"{object_id}: its category or arrays differ from what was written (digest); delete {shard.path} and run again")
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
    """The problems of the shard at `path`, or of every shard and model of the data directory there, by path."""
    if path.suffix == ".zarr":
        return {path: _problems_by_folder(path)}
    layout = Layout(path)
    found = {shard: _problems_by_folder(shard) for name in layout.artifacts() for _, shard in layout.shards(name)}
    if not any(found.values()):
        found |= {path / name: lines for name in layout.artifacts() if (lines := _problems_together(layout, name))}
    return found | {path / name: _folder_problems(layout, name) for name in folders(path)}


def _folder_problems(layout: Layout, name: str) -> list[str]:
    """What is wrong with a folder that a set stage filled: files that changed, or inputs that did since."""
    if lines := Record(layout.root / name).problems():
        return lines
    try:
        standing_record(layout, name)
    except StoreError as error:
        return [str(error)]
    return []


def _problems_together(layout: Layout, name: str) -> list[str]:
    """What is wrong with an artifact whose shards are each valid: some are not there, or its inputs have changed since."""
    whole = Collection(layout, ARTIFACTS[name])
    counts = {int(shard.attributes["shards"]) for shard in whole.shards}
    lines = [
        f"{len(whole.shards)} shards stand, of a split into {count}; run its stage for the others"
        for count in counts
        if len(whole.shards) != count
    ]
    others = [Collection(layout, ARTIFACTS[other]) for other in layout.artifacts() if other in ARTIFACTS and other != name]
    stale = whole.stale(others)
    return [*lines, stale] if stale else lines


def _problems_by_folder(path: Path) -> list[str]:
    artifact = ARTIFACTS.get(path.resolve().parent.name)
    if artifact is None:
        return [f"its folder is called {path.resolve().parent.name}; known artifacts are {', '.join(ARTIFACTS)}"]
    return problems(path, artifact)

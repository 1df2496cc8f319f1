"""Write the Zarr group of a shard."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pydantic_zarr.v3 import GroupSpec
from zarr.storage import LocalStore

from pipeline.errors import StoreError
from pipeline.store.rows import Row
from pipeline.store.spec import OBJECTS_PER_FILE, departures, group_spec
from schemas.base import COMMON, FIXED, Artifact


@dataclass(frozen=True)
class RowToPack:
    """One object of a shard to write: the shapes of its row's arrays, and how to read them; `ok` is false where there is no row."""

    object_id: str
    category: str
    split: str
    ok: bool
    shapes: Mapping[str, tuple[int, ...]]
    load: Callable[[], Row]


def write_group(path: Path, artifact: Artifact, rows: Sequence[RowToPack], constants: Row, attributes: Mapping[str, Any]) -> None:
    """Write a shard's group and check its structure; every row is read once, and at most `OBJECTS_PER_FILE` are held at a time.

    Files of zeros are written too: one that is missing later was lost.

    Raises
    ------
    StoreError
        Two objects disagree in the shape of an array, or the group departs from its schema.
    """
    shutil.rmtree(path, ignore_errors=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    shapes = _shapes(artifact, rows, constants)
    with zarr.config.set({"array.write_empty_chunks": True}):
        group: Any = group_spec(artifact, shapes, attributes).to_zarr(LocalStore(path), path="")
        group["object_id"][:] = np.array([row.object_id for row in rows], object)
        group["category"][:] = np.array([row.category for row in rows], object)
        group["split"][:] = np.array([row.split for row in rows], object)
        for name, constant in constants.items():
            group[name][...] = constant.astype(object) if artifact.arrays[name].dtype == "string" else constant
        stacked = {name: group[name] for name in shapes if "/" not in name and name not in (*COMMON, *constants)}
        for first in range(0, len(rows), OBJECTS_PER_FILE):
            _write_rows(group, stacked, artifact, rows[first : first + OBJECTS_PER_FILE], first)
    if found := list(departures(artifact, GroupSpec.from_zarr(zarr.open_group(str(path), mode="r")))):
        raise StoreError(f"{path} was written but does not fit its schema, so it is not published: {'; '.join(found)}")


def metadata_digests(path: Path, artifact: Artifact) -> dict[str, str]:
    """Compute the SHA-256 of the `zarr.json` of a group, under the empty name, and of every array at its root that it has."""
    files = {name: path / name / "zarr.json" for name in ("", *artifact.arrays)}
    return {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in files.items() if file.exists()}


def _write_rows(group: Any, stacked: Mapping[str, Any], artifact: Artifact, rows: Sequence[RowToPack], first: int) -> None:
    where = slice(first, first + len(rows))
    group["ok"][where] = np.array([row.ok for row in rows])
    loaded = [row.load() for row in rows]
    for name, array in stacked.items():
        strings = artifact.arrays[name].dtype == "string"
        blank: Any = "" if strings else np.zeros(array.shape[1:], array.dtype)
        values = [found.get(name, blank) for found in loaded]
        array[where] = np.array([str(value) for value in values], object) if strings else np.stack(values)
    for row, found in zip(rows, loaded, strict=True):
        for name, value in found.items():
            if "/" in name:
                parent, leaf = name.split("/")
                group[f"{parent}/{row.object_id}/{leaf}"][...] = value


def _shapes(artifact: Artifact, rows: Sequence[RowToPack], constants: Row) -> dict[str, tuple[int, ...]]:
    """The shape of every array of the shard, by path."""
    shapes: dict[str, tuple[int, ...]] = {name: (len(rows),) for name in COMMON}
    shapes |= {name: constant.shape for name, constant in constants.items()}
    for row in rows:
        for name, shape in row.shapes.items():
            if "/" in name:
                parent, leaf = name.split("/")
                shapes[f"{parent}/{row.object_id}/{leaf}"] = shape
            elif shapes.setdefault(name, (len(rows), *shape)) != (len(rows), *shape):
                raise StoreError(f"{artifact.name}: {name} of {row.object_id} has shape {shape}, others {shapes[name][1:]}")
    sizes = dict(FIXED)
    for name, shape in shapes.items():
        if name in artifact.arrays:
            sizes.update(zip(artifact.arrays[name].dims, shape, strict=True))
    for name, array in artifact.arrays.items():  # a shard in which every object failed still has every array
        if name not in shapes and not array.optional:
            shapes[name] = (len(rows), *(sizes.get(dim, 0) for dim in array.dims[1:]))
    return shapes

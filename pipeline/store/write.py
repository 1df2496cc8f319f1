"""Writing a shard: beside its place, validated, then renamed."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.storage import LocalStore

from pipeline.errors import StoreError
from pipeline.store.atomic import put_in_place
from pipeline.store.pieces import Piece, Row
from pipeline.store.spec import OBJECTS_A_FILE, group_spec, numpy_dtype
from pipeline.store.validate import problems
from schemas.base import COMMON, FIXED, Artifact


@dataclass(frozen=True)
class Header:
    """The objects of a shard, and the attributes of its root."""

    object_ids: Sequence[str]
    categories: Sequence[str]
    splits: Sequence[str]
    attributes: Mapping[str, Any]


def conform(artifact: Artifact, row: Mapping[str, np.ndarray], *, constants: bool = False) -> Row:
    """Check a row against its schema, name by name, and return it with the schema's dtypes.

    Raises
    ------
    StoreError
        An array is missing, unknown, has the wrong number of dimensions or kind, or holds NaN.
    """
    wanted = {name: array for name, array in artifact.arrays.items() if name not in COMMON and array.per_object != constants}
    optional = {name for name, array in wanted.items() if array.optional}
    if missing := sorted(wanted.keys() - row.keys() - optional):
        raise StoreError(f"{artifact.name}: the stage returned no {', '.join(missing)}")
    conformed: Row = {}
    for name, value in row.items():
        array = wanted.get(name) or (artifact.of(name) if "/" in name else None)
        if array is None:
            raise StoreError(f"{artifact.name}: the stage returned {name}, which its schema does not know")
        dims = array.dims[1:] if array.per_object else array.dims
        if value.ndim != len(dims):
            raise StoreError(f"{artifact.name}: {name} has shape {value.shape}, the schema says {dims}")
        dtype = np.dtype(np.str_) if array.dtype == "string" else numpy_dtype(array)
        if not np.can_cast(value.dtype, dtype, "same_kind"):
            raise StoreError(f"{artifact.name}: {name} is {value.dtype}, the schema says {array.dtype}")
        with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused below
            stored = value if array.dtype == "string" else value.astype(dtype)
        if stored.dtype.kind == "f" and not (np.isfinite(stored).all() or (array.infinite and not np.isnan(stored).any())):
            raise StoreError(f"{artifact.name}: {name} holds a value that is not finite as {array.dtype}; a kernel let it through")
        conformed[name] = stored
    return conformed


def write_shard(path: Path, artifact: Artifact, header: Header, load: Callable[[str], Piece], constants: Row, beside: Path) -> None:
    """Pack pieces into a shard at `beside`, validate it there, mark it complete, and move it to `path`.

    `load` gives the piece of an object; at most `OBJECTS_A_FILE` are held at a time. Files of zeros are written too: one that is
    missing later was lost.
    """
    shutil.rmtree(beside, ignore_errors=True)
    beside.parent.mkdir(parents=True, exist_ok=True)
    with zarr.config.set({"array.write_empty_chunks": True}):
        _write(beside, artifact, header, load, constants)
    if found := problems(beside, artifact):
        raise StoreError(f"{path} was written but does not validate, so it was not put in place: {'; '.join(found)}")
    put_in_place(beside, path)


def _write(beside: Path, artifact: Artifact, header: Header, load: Callable[[str], Piece], constants: Row) -> None:
    shapes = _shapes(artifact, header, load, constants)
    group: Any = group_spec(artifact, shapes, {**header.attributes, "complete": False}).to_zarr(LocalStore(beside), path="")
    group["object_id"][:] = np.array(header.object_ids, object)
    group["category"][:] = np.array(header.categories, object)
    group["split"][:] = np.array(header.splits, object)
    for name, constant in constants.items():
        group[name][...] = constant
    stacked = [name for name in shapes if "/" not in name and name not in (*COMMON, *constants)]
    for first in range(0, len(header.object_ids), OBJECTS_A_FILE):
        ids = header.object_ids[first : first + OBJECTS_A_FILE]
        pieces = [load(object_id) for object_id in ids]
        rows = slice(first, first + len(ids))
        group["ok"][rows] = np.array([piece.ok for piece in pieces])
        for name in stacked:
            array = group[name]
            strings = artifact.arrays[name].dtype == "string"
            blank: Any = "" if strings else np.zeros(array.shape[1:], array.dtype)
            values = [piece.row[name] if piece.ok else blank for piece in pieces]
            array[rows] = np.array([str(value) for value in values], object) if strings else np.stack(values)
        for object_id, piece in zip(ids, pieces, strict=True):
            for name, value in piece.row.items():
                if "/" in name:
                    parent, leaf = name.split("/")
                    group[f"{parent}/{object_id}/{leaf}"][...] = value
    group.attrs["complete"] = True


def _shapes(artifact: Artifact, header: Header, load: Callable[[str], Piece], constants: Row) -> dict[str, tuple[int, ...]]:
    """The shape of every array of the shard, by path, from its pieces; an error where two objects disagree."""
    count = len(header.object_ids)
    shapes: dict[str, tuple[int, ...]] = {name: (count,) for name in COMMON}
    shapes |= {name: constant.shape for name, constant in constants.items()}
    for object_id in header.object_ids:
        for name, value in load(object_id).row.items():
            if "/" in name:
                parent, leaf = name.split("/")
                shapes[f"{parent}/{object_id}/{leaf}"] = value.shape
            elif shapes.setdefault(name, (count, *value.shape)) != (count, *value.shape):
                raise StoreError(f"{artifact.name}: {name} of {object_id} has shape {value.shape}, others {shapes[name][1:]}")
    sizes = dict(FIXED)
    for name, shape in shapes.items():
        if name in artifact.arrays:
            sizes.update(zip(artifact.arrays[name].dims, shape, strict=True))
    for name, array in artifact.arrays.items():  # a shard in which every object failed still has every array
        if name not in shapes and not array.optional:
            shapes[name] = (count, *(sizes.get(dim, 0) for dim in array.dims[1:]))
    return shapes

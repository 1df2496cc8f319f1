"""The evaluation on disk: `tables.zarr`, and what a killed run had finished of it."""

from __future__ import annotations

import os
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from pydantic_zarr.v3 import GroupSpec
from zarr.storage import LocalStore

from pipeline.errors import StoreError
from pipeline.store.spec import array_spec, numpy_dtype
from schemas.evaluation import TABLES, VERSION, Table

TABLES_ZARR = "tables.zarr"

Arrays = dict[str, np.ndarray]


def write_tables(path: Path, tables: Mapping[str, Arrays], attributes: Mapping[str, Any]) -> None:
    """Write groups (`table_2`, `values/touch`, …) with the arrays that the schema declares; a `StoreError` where they are others."""
    shutil.rmtree(path, ignore_errors=True)
    zarr.create_group(
        LocalStore(path), attributes={"schema": "evaluation", "schema_version": VERSION, **attributes, "complete": False}, zarr_format=3
    )
    for name, arrays in tables.items():
        table = TABLES[name.partition("/")[0]]
        checked = _conform(name, table, arrays)
        members = {key: array_spec(table.arrays[key], value.shape) for key, value in checked.items()}
        group: Any = GroupSpec(attributes={"summary": table.summary}, members=members).to_zarr(LocalStore(path), path=name)
        for key, value in checked.items():
            group[key][...] = value
    zarr.open_group(str(path), mode="r+").attrs["complete"] = True


def _conform(name: str, table: Table, arrays: Arrays) -> Arrays:
    if set(arrays) != set(table.arrays):
        raise StoreError(f"evaluation: {name} has arrays {sorted(arrays)}, its schema says {sorted(table.arrays)}")
    sizes: dict[str, int] = {}
    for key, value in arrays.items():
        declared = table.arrays[key]
        if value.ndim != len(declared.dims) or any(sizes.setdefault(d, n) != n for d, n in zip(declared.dims, value.shape, strict=True)):
            raise StoreError(f"evaluation: {name}/{key} has shape {value.shape}, its dimensions are {declared.dims} with {sizes}")
        if value.dtype.kind == "f" and (np.isnan(value).any() or not (declared.infinite or np.isfinite(value).all())):
            raise StoreError(f"evaluation: {name}/{key} holds NaN or infinity")
    return {key: np.asarray(value, numpy_dtype(table.arrays[key])) for key, value in arrays.items()}


def _root(folder: Path) -> zarr.Group:
    path = folder / TABLES_ZARR
    try:
        root = zarr.open_group(str(path), mode="r")
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(f"{path}: no evaluation can be read there ({error}); run evaluate first") from error
    if root.attrs.get("complete") is not True or root.attrs.get("schema_version") != VERSION:
        raise StoreError(f"{path} is not complete, or not of schema version {VERSION}; run evaluate again")
    return root


def read_root(folder: Path) -> dict[str, Any]:
    """The attributes of an evaluation folder: settings, seed, configurations; a `StoreError` where there is no finished one."""
    return dict(_root(folder).attrs.asdict())


def read_table(folder: Path, name: str) -> Arrays:
    """The arrays of one group of an evaluation folder; a `StoreError` where there is no finished one, or no such group."""
    root = _root(folder)
    group = root.get(name)
    if not isinstance(group, zarr.Group):
        raise StoreError(f"{root.store_path} has no group {name}; it has {', '.join(sorted(root.group_keys()))}")
    return {key: np.asarray(array[...]) for key, array in group.arrays()}


def partial(folder: Path, configuration: str) -> Path:
    """Where a model's arrays lie until all models are evaluated."""
    return folder / f"partial-{configuration}.npz"


def save_partial(folder: Path, configuration: str, arrays: Arrays) -> None:
    """Keep a model's arrays; they are there whole or not at all."""
    path = partial(folder, configuration)
    beside = path.with_suffix(f".{os.getpid()}.tmp")
    with beside.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    beside.replace(path)


def load_partial(folder: Path, configuration: str) -> Arrays | None:
    """What `save_partial` kept, None where there is nothing, or what a crash of the machine cut short."""
    try:
        with np.load(partial(folder, configuration), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (FileNotFoundError, EOFError, ValueError, zipfile.BadZipFile):
        return None


def discard_partials(folder: Path) -> None:
    """Forget them."""
    for path in folder.glob("partial-*"):
        path.unlink()

"""The evaluation on disk: `tables.zarr` with every table and every value, and the tables again as `metrics.json`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import zarr
from pydantic import BaseModel, Field, ValidationError
from pydantic_zarr.v3 import GroupSpec
from zarr.storage import LocalStore

from pipeline.errors import StoreError
from pipeline.formats.complaints import complaints
from pipeline.store.spec import array_spec, numpy_dtype
from pipeline.store.storage import zarr_store
from schemas.evaluation import TABLES, VERSION, Table

TABLES_ZARR = "tables.zarr"
METRICS = "metrics.json"

Arrays = dict[str, np.ndarray]


class _Measured(BaseModel):
    points: int
    scale: float


class _Configuration(BaseModel):
    touch: bool


class _Root(BaseModel):
    """What is printed of the attributes."""

    settings: _Measured
    seed: int
    split: str
    configurations: Annotated[dict[str, _Configuration], Field(min_length=1)]
    left_out: dict[str, str]


def evaluation_name(training_seed: int = 0) -> str:
    """Name the folder of an evaluation, below a data directory."""
    return f"evaluation-seed-{training_seed}" if training_seed else "evaluation"


def write_evaluation(folder: Path, groups: Mapping[str, Mapping[str, Any]], attributes: Mapping[str, Any]) -> None:
    """Write `tables.zarr` with all groups (`table_2`, `values/touch`, …), and `metrics.json` with the tables alone.

    Raises
    ------
    StoreError
        A group holds other arrays than the schema declares, or their shapes disagree.
    """
    checked = {name: _conform(name, arrays) for name, arrays in groups.items()}
    shutil.rmtree(folder / TABLES_ZARR, ignore_errors=True)
    store = LocalStore(folder / TABLES_ZARR)
    zarr.create_group(store, attributes={"schema": "evaluation", "schema_version": VERSION, **attributes, "complete": False}, zarr_format=3)
    for name, arrays in checked.items():
        table = _declared(name)
        members = {key: array_spec(table.arrays[key], value.shape) for key, value in arrays.items()}
        group: Any = GroupSpec(attributes={"summary": table.summary}, members=members).to_zarr(store, path=name)
        for key, value in arrays.items():
            group[key][...] = value
    zarr.open_group(store, mode="r+").attrs["complete"] = True
    tables = {name: {key: _plain(value) for key, value in arrays.items()} for name, arrays in checked.items() if "/" not in name}
    (folder / METRICS).write_text(json.dumps({**attributes, "tables": tables}, indent=2, sort_keys=True, allow_nan=False))


def _declared(group: str) -> Table:
    return TABLES[group.partition("/")[0]]


def _conform(name: str, arrays: Mapping[str, Any]) -> Arrays:
    """Check the arrays of a group against its schema, and cast them to the types that it declares."""
    declared = _declared(name).arrays
    if set(arrays) != set(declared):
        raise StoreError(f"evaluation: {name} has arrays {sorted(arrays)}, its schema says {sorted(declared)}")
    try:
        found = {key: np.asarray(value, numpy_dtype(declared[key])) for key, value in arrays.items()}
    except (TypeError, ValueError) as error:
        raise StoreError(f"evaluation: an array of {name} is not of the type that its schema says ({error})") from error
    sizes: dict[str, int] = {}
    for key, value in found.items():
        dims = declared[key].dims
        if value.ndim != len(dims) or any(sizes.setdefault(dim, size) != size for dim, size in zip(dims, value.shape, strict=True)):
            raise StoreError(f"evaluation: {name}/{key} has shape {value.shape}, its dimensions are {dims} with {sizes}")
        if value.dtype.kind == "f" and (np.isnan(value).any() or not (declared[key].infinite or np.isfinite(value).all())):
            raise StoreError(f"evaluation: {name}/{key} holds NaN or infinity")
    return found


def _plain(values: np.ndarray) -> Any:
    """Turn an array into lists; JSON has no infinity: an interval without an end has null there."""
    return (np.where(np.isinf(values), np.array(None), values) if values.dtype.kind == "f" else values).tolist()


def _root(folder: Path) -> zarr.Group:
    path = folder / TABLES_ZARR
    try:
        root = zarr.open_group(zarr_store(path, sparse=True), mode="r")
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(f"{path}: no evaluation can be read there ({error}); run evaluate first") from error
    if root.attrs.get("complete") is not True or root.attrs.get("schema_version") != VERSION:
        raise StoreError(f"{path} is not complete, or not of schema version {VERSION}; run evaluate again")
    return root


def read_root(folder: Path) -> dict[str, Any]:
    """Read the attributes of an evaluation folder: settings, seed, configurations; a `StoreError` where there is no finished one."""
    attributes = dict(_root(folder).attrs.asdict())
    try:
        _Root.model_validate(attributes)
    except ValidationError as error:
        raise StoreError(f"{folder / TABLES_ZARR}: its attributes cannot be used: {complaints(error)}; run evaluate again") from error
    return attributes


def has_table(folder: Path, name: str) -> bool:
    """Whether an evaluation folder has a group of that name; a `StoreError` where there is no finished one."""
    return name in _root(folder)


def read_table(folder: Path, name: str) -> Arrays:
    """Read the arrays of one group of an evaluation folder; a `StoreError` where there is no finished one, no such group, or one that
    is not as its schema says.
    """
    root = _root(folder)
    group = root.get(name)
    if not isinstance(group, zarr.Group):
        raise StoreError(f"{root.store_path} has no group {name}; it has {', '.join(sorted(root.group_keys()))}")
    return _conform(name, {key: np.asarray(array[...]) for key, array in group.arrays()})


def read_surfaces(folder: Path, configuration: str) -> Arrays:
    """Read the surfaces of a configuration: its group below `predictions` or, of an implicit network, below `meshes`."""
    group = "meshes" if has_table(folder, f"meshes/{configuration}") else "predictions"
    return read_table(folder, f"{group}/{configuration}")


def surface_of(surfaces: Arrays, number: int, case: int) -> tuple[np.ndarray, np.ndarray]:
    """Take one object's surface in one case from what `read_surfaces` read: vertices (V, 3), m, and faces (F, 3)."""
    if "position" in surfaces:
        return surfaces["vertices"][number, case], surfaces["faces"]
    place = (number, case)
    at = int(np.ravel_multi_index(place, surfaces["vertex_count"].shape))
    starts = (surfaces[key].ravel()[:at].sum() for key in ("vertex_count", "face_count"))
    first, face = starts
    vertices = surfaces["vertices"][first : first + surfaces["vertex_count"][place]]
    return vertices, surfaces["faces"][face : face + surfaces["face_count"][place]]

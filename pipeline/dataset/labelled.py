"""An artifact as an xarray dataset, with labels of objects, sensors, joints and grasps."""

import json
from functools import partial
from typing import Any

import numpy as np
import xarray
from xarray.backends import BackendArray, BackendEntrypoint
from xarray.core.indexing import ExplicitIndexer, IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

from pipeline.errors import StoreError, unknown_name
from pipeline.store.directory import DataDirectory
from pipeline.store.shard import Shard
from pipeline.store.storage import Location, as_location
from pipeline.store.zarr_files import open_array, zarr_store
from schemas.catalogue import ARTIFACTS


def open_artifact(data: str | Location, artifact: str) -> xarray.Dataset:
    """Open all shards of an artifact as one labelled dataset; values are read when they are used.

    Arrays have the dimensions, units and descriptions of the schemas, and coordinates `object`, `grasp`, `sensor` and
    `joint` where they apply; ragged meshes are not opened. Rows of objects that failed are zeros: `ok` marks them, the
    attribute `failures` says why. Where objects have not been made yet, the attribute `missing` names them. Attributes
    other than text and numbers are JSON text, which netCDF can hold.

    >>> touch = open_artifact("data/toy/draft", "touch")  # doctest: +SKIP
    >>> touch.depth.sel(object="duck", sensor="thumb").min(("row", "col"))  # doctest: +SKIP
    """
    if artifact not in ARTIFACTS:
        raise StoreError(unknown_name("artifact", artifact, ARTIFACTS))
    collection = DataDirectory(as_location(data)).collection(ARTIFACTS[artifact])
    first_index = collection.shards.index(collection.first)  # an error without shards
    shards = [_open_shard(shard) for shard in collection.shards]
    opened = shards[0]
    if len(shards) > 1:
        lazy = [shard.assign({name: _lazy(array.variable) for name, array in shard.data_vars.items()}) for shard in shards]
        filled = [d if shard.has_rows else _zeros(d, lazy[first_index]) for shard, d in zip(collection.shards, lazy, strict=True)]
        opened = xarray.concat(filled, "object", data_vars="minimal", coords="minimal", compat="override")
        opened = opened.assign_coords({name: label.compute() for name, label in opened.coords.items()}).sortby("object")
    for variable in opened.variables.values():
        variable.encoding = {name: value for name, value in variable.encoding.items() if name not in ("chunks", "shards")}  # of its files
    attributes = dict(shards[0].attrs)
    rows = [row for shard in collection.shards for row in shard.record.rows]
    attributes["failures"] = {row.object_id: row.failure.model_dump() for row in rows if row.failure}
    if collection.missing:
        attributes["missing"] = list(collection.missing)
    plain = {name: value if type(value) in (str, int, float) else json.dumps(value) for name, value in attributes.items()}
    return opened.assign_attrs(plain)


def _lazy(array: xarray.Variable) -> xarray.Variable:
    """Make an array lazy: it is read in blocks of as many objects as share a chunk."""
    return array.chunk({"object": array.encoding["chunks"][0]} if "object" in array.dims else {})


def _zeros(shard: xarray.Dataset, template: xarray.Dataset) -> xarray.Dataset:
    """Add zeros to a shard in which every object failed, in the shapes of another shard's arrays."""
    rows = {"object": [0] * shard.sizes["object"]}
    arrays = {str(name): array.variable for name, array in template.data_vars.items() if "object" in array.dims}
    zeros = {name: xarray.full_like(array.isel(rows), "" if array.dtype.kind in "OUT" else 0) for name, array in arrays.items()}
    return shard.drop_vars(zeros.keys(), errors="ignore").assign(zeros)


def _open_shard(shard: Shard) -> xarray.Dataset:
    shard.check_arrays()
    with shard.errors_as_damage("it cannot be opened"):
        plain = xarray.open_dataset(shard, engine=_ShardReader)  # type: ignore[arg-type]  # our reader takes a Shard
        labelled: xarray.Dataset = plain.drop_vars("object_id").set_coords(["category", "split", "ok"])
        for name in labelled.coords:
            labelled[name].load()
    return labelled


class _ShardReader(BackendEntrypoint):
    """Opens a shard for xarray, which reads values when they are used, with the errors of `Shard.read` in place of Zarr's."""

    def open_dataset(self, filename_or_obj: Any, *, drop_variables: Any = None) -> xarray.Dataset:
        shard: Shard = filename_or_obj
        plain = xarray.open_zarr(zarr_store(shard.path), consolidated=False, chunks=None)
        stored = {str(name): array.variable for name, array in plain.data_vars.items()}
        lazy = {
            name: (variable.dims, LazilyIndexedArray(_LazyArray(shard, name)), variable.attrs, variable.encoding)
            for name, variable in stored.items()
        }
        dataset: xarray.Dataset = plain.assign(lazy)
        return dataset


class _LazyArray(BackendArray):
    """The values of an array of a shard."""

    def __init__(self, shard: Shard, name: str) -> None:
        self._shard, self._name = shard, name
        stored = open_array(shard.path, name, shard.stored(name).metadata)
        self.shape, self.dtype = stored.shape, stored.dtype

    def __dask_tokenize__(self) -> tuple[str, str]:
        return str(self._shard.path), self._name

    def __getitem__(self, key: ExplicitIndexer) -> np.ndarray:
        read = partial(self._shard.read, self._name)
        return np.asarray(explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER_1VECTOR, read))

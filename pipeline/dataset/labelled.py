"""An artifact as an xarray dataset, with labels of objects, sensors, joints and grasps."""

from __future__ import annotations

import xarray

from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory
from pipeline.store.shard import Shard
from pipeline.store.storage import Place, place, zarr_store
from schemas.catalogue import ARTIFACTS


def open_artifact(data: str | Place, artifact: str) -> xarray.Dataset:
    """Open all shards of an artifact as one labelled dataset; values are read when they are used.

    Parameters
    ----------
    data
        A data directory.
    artifact
        surfaces, grasps, vision, touch or charts.

    Returns
    -------
    Arrays with the dimensions, units and descriptions of the schemas, and coordinates `object`, `grasp`, `sensor` and `joint`
    where they apply; ragged meshes are left out. Rows of objects that failed are zeros: `ok` tells them apart.

    Raises
    ------
    StoreError
        There is no such artifact, or it has not been made.

    Examples
    --------
    >>> touch = open_artifact("data/toy/draft", "touch")  # doctest: +SKIP
    >>> touch.depth.sel(object="duck", sensor="thumb").min(("row", "col"))  # doctest: +SKIP
    """
    if artifact not in ARTIFACTS:
        raise StoreError(f"there is no artifact {artifact}; there are {', '.join(ARTIFACTS)}")
    collection = DataDirectory(place(data)).collection(ARTIFACTS[artifact])
    collection.first  # noqa: B018 (an error where there is none)
    shards = [_opened(shard) for shard in collection.shards]
    if len(shards) == 1:
        return shards[0]
    lazy = [shard.map(_lazy, keep_attrs=True) for shard in shards]
    whole: xarray.Dataset = xarray.concat(lazy, "object", data_vars="minimal", coords="minimal", compat="override")
    return whole.assign_coords({name: label.compute() for name, label in whole.coords.items()}).sortby("object")


def _lazy(array: xarray.DataArray) -> xarray.DataArray:
    """Let an array be read by as many objects as lie in a chunk of it."""
    return array.chunk({"object": array.encoding["chunks"][0]} if "object" in array.dims else {})


def _opened(shard: Shard) -> xarray.Dataset:
    shard.check_arrays()
    with shard.errors_as_damage("it cannot be opened"):
        plain = xarray.open_zarr(zarr_store(shard.path), consolidated=False, chunks=None)
        named: xarray.Dataset = plain.set_coords(["category", "split", "ok"]).set_index(object="object_id")
        for name in named.coords:
            named[name].load()
    return named

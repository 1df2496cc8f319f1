"""The arrays of one split of a data set, in memory: only those that are asked for, each read once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import StoreError
from pipeline.store.collection import Collection, usable_objects
from pipeline.store.layout import Layout
from schemas.catalogue import ARTIFACTS, artifact_of


@dataclass(frozen=True)
class Split:
    """The usable objects of a split, in id order.

    Attributes
    ----------
    arrays
        By name: (object, …) for arrays with an object dimension, as stored for constants such as `untouched` and `camera`.
        Shapes, units and frames are the schemas'.
    attributes
        By artifact: what its root says, such as the sensor's description under `touch`.
    left_out
        Objects that failed in an artifact that was asked for, with the reason.
    """

    name: str
    object_ids: list[str]
    categories: list[str]
    arrays: dict[str, np.ndarray]
    attributes: dict[str, Mapping[str, Any]]
    left_out: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.object_ids)


def load_split(data: Path, arrays: Sequence[str], split: str) -> Split:
    """Read arrays of every usable object of a split; an artifact that holds none of them is never opened.

    Raises
    ------
    StoreError
        No such array; an artifact has not been made, or from other inputs than stand there now; no usable object.
    """
    collections = {artifact_of(name).name: Collection(Layout(data), artifact_of(name)) for name in arrays}
    for collection in collections.values():
        if stale := collection.stale(list(collections.values())):
            raise StoreError(f"{data.resolve()}: {stale}")
        if len({shard.attributes["constants_digest"] for shard in collection.shards}) > 1:
            name = collection.artifact.name
            raise StoreError(
                f"{data.resolve()}: the shards of {name} were made with different scenes or sensors; run its stage again for all"
            )
    object_ids, left_out = usable_objects(collections, split)
    if not object_ids:
        where = ", ".join(f"{data.resolve() / name}" for name in collections)
        failed = f"; {len(left_out)} have failed, see `vt-pipeline status`" if left_out else ""
        raise StoreError(f"no usable object of split {split} in {where}{failed}; the manifest's `splits` say how many there are")
    shard = next(iter(collections.values())).shard
    return Split(
        name=split,
        object_ids=object_ids,
        categories=[str(shard(name).view(name)["category"]) for name in object_ids],
        arrays={name: _read(collections[artifact_of(name).name], name, object_ids) for name in arrays},
        attributes={name: collection.shard(object_ids[0]).attributes for name, collection in collections.items()},
        left_out=left_out,
    )


def _read(collection: Collection, name: str, object_ids: Sequence[str]) -> np.ndarray:
    shard = collection.shard(object_ids[0])
    if not shard.has(name):
        raise StoreError(f"{shard.path} has no {name}: it was made without; turn on the setting for it and run again")
    if not ARTIFACTS[collection.artifact.name].arrays[name].per_object:
        return np.asarray(shard.array(name)[...])
    return np.stack([collection.view(object_id)[name] for object_id in object_ids])

"""Reading a data set in training: a torch `Dataset` of grasps, over all shards, that opens only what is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from pipeline.errors import StoreError
from pipeline.kernels.touch.contact import local_points
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.collection import Collection, usable_objects
from pipeline.store.layout import Layout
from pipeline.store.shard import Shard
from schemas.base import Array, Artifact
from schemas.catalogue import ARTIFACTS, artifact_of

DERIVED = {"local_points": "depth", "local_count": "depth"}
"""Arrays that need not be stored, and the stored array of the artifact that gives them."""

Item = dict[str, Any]


class GraspDataset(Dataset[Item]):
    """The grasps of a data set's split, each a dict of tensors and the object's name.

    Arrays with a grasp dimension give that grasp's part, arrays of the object come whole, constants (`camera`,
    `untouched`) as they are; shapes, units and frames are the schemas'. `local_points` and `local_count` are
    recomputed from depth and pose where they are not stored: the same to the bit. Objects that failed in any artifact
    asked for are left out, and listed in `left_out` with their reasons.

    Parameters
    ----------
    data
        A data directory.
    arrays
        Names of arrays. Only artifacts that hold one of them are opened.
    split
        train, valid or test; None for all objects.

    Raises
    ------
    StoreError
        No such array, an artifact that has not been made, or a split without objects, with the place looked at.
    """

    def __init__(self, data: str | Path, arrays: Sequence[str], split: str | None = "train") -> None:
        self.data = Path(data)
        self.arrays = tuple(arrays)
        self._owner = {name: _artifact_of(name) for name in self.arrays}
        needed = {artifact.name: artifact for artifact in (*self._owner.values(), ARTIFACTS["surfaces"], ARTIFACTS["grasps"])}
        self._collections = {name: Collection(Layout(self.data), artifact) for name, artifact in needed.items()}
        for collection in self._collections.values():
            if stale := collection.stale(list(self._collections.values())):
                raise StoreError(f"{self.data.resolve()}: {stale}")
        usable, self.left_out = usable_objects(self._collections, split)
        self.items: list[tuple[str, int]] = []
        for object_id in usable:
            grasps = self._collections["grasps"].shard(object_id).array("hand_pose").shape[1]
            self.items += [(object_id, grasp) for grasp in range(grasps)]
        if not self.items:
            failed = f"{len(self.left_out)} have failed, see `vt-pipeline status`"
            raise StoreError(f"{self.data.resolve()} has no usable objects in split {split}; {failed}")

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index: int) -> Item:
        object_id, grasp = self.items[index]
        item: Item = {name: _tensor(self._read(name, object_id, grasp)) for name in self.arrays}
        return {"object_id": object_id, "grasp": grasp, **item}

    def _read(self, name: str, object_id: str, grasp: int) -> np.ndarray:
        artifact = self._owner[name]
        shard = self._collections[artifact.name].shard(object_id)
        if name in DERIVED and not shard.has(name):
            return self._local(shard, object_id, grasp)[name]
        if not shard.has(name):
            raise StoreError(f"{shard.path} has no {name}: it was made without; turn on the setting for it and run again")
        declared: Array = artifact.arrays[name]
        array = shard.array(name)
        if not declared.per_object:
            return np.asarray(array[...])
        row = shard.rows[object_id]
        if "grasp" not in declared.dims:
            return np.asarray(array[row])
        return np.asarray(array[row, grasp])

    def _local(self, shard: Shard, object_id: str, grasp: int) -> dict[str, np.ndarray]:
        sensor = Sensor.model_validate(shard.attributes["sensor"])
        grasps = self._collections["grasps"].shard(object_id)
        depths = np.asarray(shard.array("depth")[shard.rows[object_id], grasp])
        poses = np.asarray(grasps.array("sensor_pose")[grasps.rows[object_id], grasp])
        found = [local_points(depth, pose, sensor) for depth, pose in zip(depths, poses, strict=True)]
        return {"local_points": np.stack([points for points, _ in found]), "local_count": np.stack([count for _, count in found])}


def _tensor(value: np.ndarray) -> torch.Tensor | str:
    """A tensor, or the string itself where the array holds strings."""
    return str(value) if value.dtype.kind in "OUT" else torch.from_numpy(value)


def _artifact_of(name: str) -> Artifact:
    try:
        return artifact_of(name)
    except KeyError as error:
        raise StoreError(error.args[0]) from None

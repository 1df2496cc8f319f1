"""A grasp, or several of one object, from a data directory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import StoreError
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.collection import Collection, check_origins
from pipeline.store.layout import Layout
from pipeline.store.record import RECORD, check_models, standing_record
from pipeline.store.shard import Shard
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from schemas.vision import VISION


def check_folder(models: Path, data: Path, configuration: str) -> None:
    """A `StoreError` where a data directory's own model was made from other rows than stand there now."""
    if models.resolve() == (data / "models").resolve() and (models / "gcn" / configuration / RECORD).exists():
        standing_record(Layout(data), f"models/gcn/{configuration}")


def stored_image(data: Path, object_id: str, grasp: int, which: str) -> NDArray[np.uint8]:
    """The object's image, alone or in a grasp: `which` is unoccluded or occluded."""
    shard = _shard(data, VISION, object_id)
    if not shard.has(which):
        raise StoreError(f"{shard.path} has no {which} images: it was made without; set render-vision's setting for it and run again")
    stored = shard.array(which)
    row = shard.rows[object_id]
    if which == "unoccluded":
        return np.asarray(stored[row])
    _check_grasps([grasp], stored.shape[1], object_id)
    return np.asarray(stored[row, grasp])


def has_charts(data: Path) -> bool:
    """Whether touch charts stand in a data directory."""
    return bool(Layout(data).shards(CHARTS.name))


def stored_charts(data: Path, object_id: str, grasps: Sequence[int]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """The charts of these grasps (grasp, sensor, S, 3), world, m, and their stop rules (grasp, sensor)."""
    charts = Collection(Layout(data), CHARTS)
    check_models(Layout(data), charts)
    check_origins([charts])
    view = _shard(data, CHARTS, object_id).view(object_id)
    vertices, rule = view["vertices"], view["stop_rule"]
    _check_grasps(grasps, len(vertices), object_id)
    chosen = list(grasps)
    return vertices[chosen], rule[chosen]


def stored_touches(
    data: Path, object_id: str, grasps: Sequence[int]
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_], Sensor]:
    """Readings (T, rows, cols, 3), sensor poses (T, 4, 4) and touches (T,) of these grasps, and the sensor."""
    touch, grasped = _shard(data, TOUCH, object_id), _shard(data, GRASPS, object_id)
    _check_grasps(grasps, touch.array("reading").shape[1], object_id)
    row = touch.rows[object_id]
    readings = np.concatenate([np.asarray(touch.array("reading")[row, grasp]) for grasp in grasps])
    view = grasped.view(object_id)
    chosen = list(grasps)
    poses, touched = view["sensor_pose"][chosen].reshape(-1, 4, 4), view["touch_success"][chosen].reshape(-1)
    return readings, poses, touched, Sensor.model_validate(touch.attributes["sensor"])


def check_grasps(data: Path, object_id: str, grasps: Sequence[int]) -> None:
    """A `StoreError` where an object, or one of its grasps, is not in a data directory."""
    _check_grasps(grasps, _shard(data, GRASPS, object_id).array("hand_pose").shape[1], object_id)


def _shard(data: Path, artifact: Artifact, object_id: str) -> Shard:
    shard = Collection(Layout(data), artifact).shard(object_id)
    if failure := shard.failure(object_id):
        raise StoreError(f"{object_id} failed in {failure['stage']}: {failure['reason']}")
    return shard


def _check_grasps(grasps: Sequence[int], available: int, object_id: str) -> None:
    if wrong := [grasp for grasp in grasps if not 0 <= grasp < available]:
        raise StoreError(f"{object_id} has no grasp {wrong[0]}; there are grasps 0 to {available - 1}")

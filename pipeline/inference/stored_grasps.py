"""A grasp, or several of one object, from a data directory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StoreError
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.directory import DataDirectory
from schemas.charts import CHARTS


def stored_image(data: Path, object_id: str, grasp: int, which: str) -> NDArray[np.uint8]:
    """Read the object's image, alone or in a grasp: `which` is unoccluded or occluded."""
    rows = _rows(data, [which], object_id)
    if which == "occluded":
        check_grasps(rows, which, object_id, [grasp])
    return rows.read(which, object_id, grasp)


def has_charts(data: Path) -> bool:
    """Whether a data directory has touch charts."""
    return bool(DataDirectory(data).collection(CHARTS).shards)


def stored_charts(data: Path, object_id: str, grasps: Sequence[int]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Read the charts of these grasps (grasp, sensor, S, 3), world, m, and their stop rules (grasp, sensor)."""
    rows = _rows(data, ["vertices", "stop_rule"], object_id)
    check_grasps(rows, "vertices", object_id, grasps)
    chosen = list(grasps)
    return rows.read("vertices", object_id)[chosen], rows.read("stop_rule", object_id)[chosen]


def stored_touches(
    data: Path, object_id: str, grasps: Sequence[int]
) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_], Sensor]:
    """Read tactile images (T, rows, cols, 3), sensor poses (T, 4, 4) and touches (T,) of these grasps, and the sensor."""
    rows = _rows(data, ["reading", "sensor_pose", "touch_success"], object_id)
    check_grasps(rows, "reading", object_id, grasps)
    readings, poses, touched = (np.concatenate([rows.read(name, object_id, grasp) for grasp in grasps]) for name in rows.arrays)
    return readings, poses, touched, Sensor.model_validate(rows.attributes("touch")["sensor"])


def check_object(data: Path, object_id: str, grasps: Sequence[int]) -> None:
    """Check that an object and its grasps are in a data directory; a `StoreError` where they are not."""
    check_grasps(_rows(data, ["joint_angles"], object_id), "joint_angles", object_id, grasps)


def _rows(data: Path, arrays: Sequence[str], object_id: str) -> ObjectRows:
    rows = ObjectRows(data, arrays, split=None)
    if object_id in rows.left_out:
        raise StoreError(f"{object_id} failed in {rows.left_out[object_id]}")
    if object_id not in rows.object_ids:
        few = ", ".join(rows.object_ids[:5])
        raise StoreError(f"{data.resolve()} has no object {object_id}; it has {few}{', …' if len(rows) > 5 else ''}")
    return rows


def check_grasps(rows: ObjectRows, array: str, object_id: str, grasps: Sequence[int]) -> None:
    """Check that an object has these grasps; a `StoreError` where it has not."""
    available = rows.size(array, "grasp")
    if wrong := [grasp for grasp in grasps if not 0 <= grasp < available]:
        raise StoreError(f"{object_id} has no grasp {wrong[0]}; there are grasps 0 to {available - 1}")

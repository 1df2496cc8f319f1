"""The grasps of one object of a data directory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StoreError


def open_grasps(data: Path, arrays: Sequence[str], object_id: str, grasps: Sequence[int]) -> ObjectRows:
    """Open these arrays of a data directory, in which there must be an object with these grasps.

    Raises
    ------
    StoreError
        There is no such object, it failed, or it has no such grasp.
    """
    rows = ObjectRows(data, [*arrays, "joint_angles"], split=None)  # which says how many grasps there are
    if object_id in rows.left_out:
        raise StoreError(f"{object_id} failed in {rows.left_out[object_id]}")
    if object_id not in rows.object_ids:
        few = ", ".join(rows.object_ids[:5])
        raise StoreError(f"{data.resolve()} has no object {object_id}; it has {few}{', …' if len(rows) > 5 else ''}")
    available = rows.size("joint_angles", "grasp")
    if wrong := [grasp for grasp in grasps if not 0 <= grasp < available]:
        raise StoreError(f"{object_id} has no grasp {wrong[0]}; there are grasps 0 to {available - 1}")
    return rows

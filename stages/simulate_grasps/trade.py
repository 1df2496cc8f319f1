"""The trade-off of `simulate-grasps`: the number of sensors that touch against the time of the search."""

from __future__ import annotations

from pathlib import Path

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.trade import Trade


def missing_touches(data: Path, reference: Path) -> dict[str, float]:
    """Compute the share of the sensors of all kept grasps that do not touch, % by object."""
    rows = ObjectRows(data, ("touch_success",), split=None)
    return {name: 100 * (1 - float(rows.read("touch_success", name).mean())) for name in rows.object_ids}


def sensors_of_grasps(data: Path) -> int:
    """Count the sensors of the kept grasps of an object."""
    rows = ObjectRows(data, ("touch_success",), split=None)
    return rows.read("touch_success", rows.object_ids[0]).size


TRADE = Trade(
    metric="sensors of kept grasps that do not touch",
    unit="%",
    candidates=(
        {"ik_samples": 256, "ik_refinements": 0},
        {"ik_samples": 256},
        {"ik_refinements": 1},
        {"attempts": 10},
        {"ik_samples": 2048},
    ),
    errors=missing_touches,
    trials=sensors_of_grasps,
)

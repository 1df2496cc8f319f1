"""Touches of the objects of each category, counted."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.errors import StoreError
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from schemas.catalogue import ARTIFACTS

SUPPLEMENT_SUCCESS = {"bottle": 71.8, "knife": 54.1, "cellphone": 67.2, "rifle": 53.6}
"""Table 1: per cent of touches that succeed."""


@dataclass
class Tally:
    """Touches of the objects of one category."""

    touched: list[np.ndarray] = field(default_factory=list)
    """(grasp, sensor) bool of every object: which touches of the kept grasps succeed."""
    tried: list[np.ndarray] = field(default_factory=list)
    """(sensor,) of every object: the share of all attempts in which a sensor touched."""
    attempts: int = 0

    def row(self) -> tuple[int, int, int, float, float]:
        """Objects, grasps, touches, and per cent of touches that succeed: of those kept, of all attempts."""
        touched = np.concatenate(self.touched)
        return len(self.touched), len(touched), touched.size, 100 * touched.mean(), 100 * float(np.mean(self.tried))


def tally(data: Path) -> dict[str, Tally]:
    """The touches of every category in a data directory, failed objects left out."""
    grasps = Collection(Layout(data), ARTIFACTS["grasps"])
    found: dict[str, Tally] = defaultdict(Tally)
    for object_id in grasps:
        shard = grasps.shard(object_id)
        if shard.failure(object_id) is None:
            view = shard.view(object_id)
            entry = found[str(view["category"])]
            entry.touched.append(view["touch_success"])
            entry.tried.append(view["attempt_success"])
            entry.attempts += int(view["attempts"])
    if not found:
        raise StoreError(f"{data.resolve()} has no grasps; run `make dataset`, or see `vt-pipeline status {data}`")
    return dict(sorted(found.items()))


def sensors_of(data: Path) -> list[str]:
    """The names of the fingers that wear the sensors, in their order."""
    names: list[str] = Collection(Layout(data), ARTIFACTS["grasps"]).shards[0].attributes["hand"]["sensors"]
    return names

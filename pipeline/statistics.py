"""A data set's grasps in numbers, beside Table 1 and section 1.6 of the supplement."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from pipeline.store.shard import StoreError
from schemas.catalogue import ARTIFACTS

SUPPLEMENT_SUCCESS = {"bottle": 71.8, "knife": 54.1, "cellphone": 67.2, "rifle": 53.6}
"""Table 1: per cent of touches that succeed."""

SUPPLEMENT_HISTOGRAM = (None, 9.47, 26.08, 53.83, 10.61)
"""1.6: per cent of grasps with 1 to 4 successful touches; of none it says nothing."""


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


def show(found: dict[str, Tally], sensors: list[str], console: Console) -> None:
    """Print the tables; the supplement's touches a grasp beside ours where there are as many sensors."""
    everything = Tally([t for e in found.values() for t in e.touched], [t for e in found.values() for t in e.tried])
    table = Table("class", "objects", "grasps", "touches", "% successful", "supplement", "% of all attempts", box=None, padding=(0, 2))
    for name, entry in [*found.items(), ("all", everything)]:
        objects, grasps, touches, kept, tried = entry.row()
        theirs = 62.7 if name == "all" else SUPPLEMENT_SUCCESS.get(name)
        numbers = (f"{objects}", f"{grasps}", f"{touches}", f"{kept:.1f}", f"{theirs:.1f}" if theirs else "–", f"{tried:.1f}")
        table.add_row(name, *numbers)
    console.print(table)

    touched = np.concatenate(everything.touched)
    counts = np.bincount(touched.sum(axis=1), minlength=touched.shape[1] + 1)
    table = Table("touches a grasp, %", *map(str, range(len(counts))), box=None, padding=(0, 2))
    table.add_row("here", *(f"{100 * count / len(touched):.1f}" for count in counts))
    if len(counts) == len(SUPPLEMENT_HISTOGRAM):
        table.add_row("supplement", *("–" if share is None else f"{share:.1f}" for share in SUPPLEMENT_HISTOGRAM))
    console.print(table)
    table = Table("touches a finger, %", *map(escape, sensors), box=None, padding=(0, 2))
    table.add_row("kept", *(f"{100 * share:.1f}" for share in touched.mean(axis=0)))
    table.add_row("all attempts", *(f"{100 * share:.1f}" for share in np.mean(everything.tried, axis=0)))
    console.print(table)

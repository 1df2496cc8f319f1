"""A dataset's grasps in numbers, beside Table 1 and section 1.6 of the supplement."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.dataset.touch_statistics import SUPPLEMENT_SUCCESS, Tally

SUPPLEMENT_HISTOGRAM = (None, 9.47, 26.08, 53.83, 10.61)
"""1.6: per cent of grasps with 1 to 4 successful touches; of none it says nothing."""


def show(found: dict[str, Tally], sensors: list[str], console: Console) -> None:
    """Print the tables; the supplement's touches per grasp beside ours where there are as many sensors."""
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
    table = Table("touches per grasp, %", *map(str, range(len(counts))), box=None, padding=(0, 2))
    table.add_row("here", *(f"{100 * count / len(touched):.1f}" for count in counts))
    if len(counts) == len(SUPPLEMENT_HISTOGRAM):
        table.add_row("supplement", *("–" if share is None else f"{share:.1f}" for share in SUPPLEMENT_HISTOGRAM))
    console.print(table)
    table = Table("touches per finger, %", *map(escape, sensors), box=None, padding=(0, 2))
    table.add_row("kept", *(f"{100 * share:.1f}" for share in touched.mean(axis=0)))
    table.add_row("all attempts", *(f"{100 * share:.1f}" for share in np.mean(everything.tried, axis=0)))
    console.print(table)

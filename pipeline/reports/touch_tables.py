"""A dataset's grasps in numbers, beside Table 1 and section 1.6 of the supplement."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from pipeline.console import Row, Table, show_tables
from pipeline.dataset.touch_statistics import SUPPLEMENT_SUCCESS, Tally

SUPPLEMENT_HISTOGRAM = (9.47, 26.08, 53.83, 10.61)
"""1.6: per cent of grasps with 1 to 4 successful touches; of none it says nothing."""

OPPOSED = 90
"""Degrees between the normals of two contacts, above which they press against each other."""


def show(found: dict[str, Tally], sensors: list[str], console: Console) -> None:
    """Print the tables."""
    show_tables(console, tables(found, sensors))


def tables(found: dict[str, Tally], sensors: list[str]) -> list[Table]:
    """Make the tables; the supplement's touches per grasp beside ours where there are as many sensors."""
    everything = Tally([t for e in found.values() for t in e.touched], [t for e in found.values() for t in e.tried])
    everything.held = [grasps for entry in found.values() for grasps in entry.held]
    everything.lifted = [grasps for entry in found.values() for grasps in entry.lifted]
    rows = []
    for name, entry in [*found.items(), ("all", everything)]:
        *counts, kept, tried = entry.row()
        theirs = (SUPPLEMENT_SUCCESS | {"all": 62.7}).get(name)
        rows.append(Row([name, *counts, f"{kept:.1f}", theirs, f"{tried:.1f}"]))
    columns = ["class", "objects", "grasps", "touches", "% successful", "supplement", "% of all attempts"]
    made = [Table("", columns, rows), *_hold(found, everything)]
    touched = np.concatenate(everything.touched)
    shares = touches_per_grasp(touched)
    rows = [Row(["here", *_rounded(shares)])]
    if supplement := supplement_touches(len(shares)):
        rows.append(Row(["supplement", None, *_rounded(supplement[1:])]))
    made.append(Table("", ["touches per grasp, %", *map(str, range(len(shares)))], rows))
    kept_shares, tried_shares = (_rounded(100 * np.mean(one, axis=0)) for one in (touched, everything.tried))
    rows = [Row(["kept", *kept_shares]), Row(["all attempts", *tried_shares])]
    return [*made, Table("", ["touches per finger, %", *sensors], rows)]


def touches_per_grasp(touched: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Compute the per cent of grasps with 0, 1, … successful touches from `touched` (grasp, sensor)."""
    return np.asarray(100 * np.bincount(touched.sum(axis=1), minlength=touched.shape[1] + 1) / len(touched))


def supplement_touches(count: int) -> tuple[float, ...]:
    """The supplement's per cent of grasps with 0, 1, … touches, the first one 0; empty where the hand has another number of sensors."""
    return (0.0, *SUPPLEMENT_HISTOGRAM) if count == 1 + len(SUPPLEMENT_HISTOGRAM) else ()


def _hold(found: dict[str, Tally], everything: Tally) -> list[Table]:
    """Make the table of how well the kept grasps hold; none of a dataset that does not say."""
    if not everything.held:
        return []
    rows = []
    for name, entry in [*found.items(), ("all", everything)]:
        area, angle, margin = np.concatenate(entry.held).T
        lifted = (f"{100 * np.concatenate(entry.lifted).mean():.1f}",) if entry.lifted else ()
        shares = (f"{100 * (angle > OPPOSED).mean():.1f}", f"{100 * (margin > 0).mean():.1f}", *lifted)
        rows.append(Row([name, f"{area.mean():.0f}", *shares]))
    titles = ["class", "area of contact per grasp, mm²", f"% with contacts over {OPPOSED}° apart", "% with force closure"]
    return [Table("", [*titles, "% held in the lift test"] if everything.lifted else titles, rows)]


def _rounded(shares: Iterable[float]) -> list[str]:
    return [f"{share:.1f}" for share in shares]

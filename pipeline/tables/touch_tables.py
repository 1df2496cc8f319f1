"""Statistics of a dataset's grasps, beside Table 1 and section 1.6 of the supplement."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pipeline.config.manifest import TOTAL
from pipeline.console import Row, Table
from pipeline.dataset.touch_statistics import PAPER, SUPPLEMENT_SUCCESS, Tally
from pipeline.tables.hold_tables import hold_tables

SUPPLEMENT_HISTOGRAM = (9.47, 26.08, 53.83, 10.61)
"""Section 1.6: per cent of grasps with 1 to 4 successful touches."""

OPPOSED = 90
"""Degrees between the normals of two contacts, above which they press against each other."""


def touch_tables(
    tallies: dict[str, Tally],  # by class
    sensors: list[str],
    *,
    paper: bool,  # put the paper's figures beside ours; touches per grasp only for the same number of sensors
) -> list[Table]:
    """Make the tables of touches by class, for sensors of these names."""
    total = Tally.joined(tallies.values())
    rows = []
    for name, entry in [*tallies.items(), (TOTAL, total)]:
        *counts, successful, attempted = entry.row()
        theirs = SUPPLEMENT_SUCCESS.get(name)
        rows.append(Row([name, *counts, f"{successful:.1f}", *([theirs] if paper else []), f"{attempted:.1f}"]))
    columns = [
        "class",
        "objects",
        "grasps",
        "touches",
        "% successful",
        *([f"% in {PAPER}"] if paper else []),
        "% of attempts, mean over objects",
    ]
    tables = [Table("Touches", columns, rows), *_contacts(tallies, total), *hold_tables(tallies)]
    touched = np.concatenate(total.touched)
    shares = touches_per_grasp(touched)
    rows = [Row(["here", *_rounded(shares)])]
    if paper and (supplement := supplement_touches(len(shares))):
        rows.append(Row([PAPER, None, *_rounded(supplement[1:])]))
    tables.append(Table("Grasps by their number of successful touches, %", ["touches", *map(str, range(len(shares)))], rows))
    kept_shares, tried_shares = (_rounded(100 * np.mean(grasps, axis=0)) for grasps in (touched, total.tried))
    rows = [Row(["kept", *kept_shares]), Row(["attempts, mean over objects", *tried_shares])]
    return [*tables, Table("Successful touches of each sensor, %", ["grasps", *sensors], rows)]


def touches_per_grasp(touched: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Compute the per cent of grasps with 0, 1, … successful touches from `touched` (grasp, sensor)."""
    return np.asarray(100 * np.bincount(touched.sum(axis=1), minlength=touched.shape[1] + 1) / len(touched))


def supplement_touches(count: int) -> tuple[float, ...]:
    """Give the supplement's per cent of grasps with 0, 1, … touches; empty for another number of sensors."""
    return (0.0, *SUPPLEMENT_HISTOGRAM) if count == 1 + len(SUPPLEMENT_HISTOGRAM) else ()


def _contacts(tallies: dict[str, Tally], total: Tally) -> list[Table]:
    """Make the table of contact areas, opposition and force closure of the kept grasps, if the dataset has those figures."""
    if not total.hold_measures:
        return []
    rows = []
    for name, entry in [*tallies.items(), (TOTAL, total)]:
        area, angle, margin = np.concatenate(entry.hold_measures).T
        rows.append(Row([name, f"{area.mean():.0f}", f"{100 * (angle > OPPOSED).mean():.1f}", f"{100 * (margin > 0).mean():.1f}"]))
    titles = ["class", "area of contact per grasp, mm²", f"% with contacts over {OPPOSED}° apart", "% with force closure"]
    return [Table("Contacts", titles, rows)]


def _rounded(shares: Iterable[float]) -> list[str]:
    return [f"{share:.1f}" for share in shares]

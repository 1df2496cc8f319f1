"""Tables of the hold test: which kept grasps hold the object, by class, by the object's size and by the direction of gravity."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.config.manifest import TOTAL
from pipeline.console import Row, Table
from pipeline.dataset.touch_statistics import Tally

SIZES = 5
"""Maximum number of size bins; each but the last has an equal share of the objects."""
MIN_RATIO, SAME = 1.05, 1 + 1e-6
"""Least ratio of the lower ends of successive bins; and ratio up to which sizes are equal, as those of objects scaled to one size."""
DIRECTIONS = ("−x", "+x", "−y", "+y", "−z", "+z")
"""Directions of gravity, as in `held_directions`."""


def hold_tables(tallies: Mapping[str, Tally]) -> list[Table]:
    """Make the tables, beside the touches, of the tallies by class; none for a dataset whose grasps were not tested."""
    total = Tally.joined(tallies.values())
    if not total.held:
        return []
    by_size = [(name, total.part(numbers)) for name, numbers in size_bins(np.array(total.diagonals)).items()]
    parts = {"class": [*tallies.items(), (TOTAL, total)], "diagonal": by_size}
    titles = {"class": "Kept grasps that hold the object, by class", "diagonal": "The same, by the diagonal of the object's bounding box"}
    return [_table(titles[grouping], grouping, entries, by_direction=bool(total.held_directions)) for grouping, entries in parts.items()]


def size_bins(
    diagonals: NDArray[np.float64],  # (N,) m
) -> dict[str, NDArray[np.intp]]:  # object numbers by bin name, from small to large
    """Sort objects into bins of size, whose ends are the data's, by their diagonals."""
    min_count, bins = np.ceil(len(diagonals) / SIZES), list[list[int]]()
    for number in np.argsort(diagonals, kind="stable").tolist():
        size = diagonals[number]
        if bins and (len(bins[-1]) < min_count or size < MIN_RATIO * diagonals[bins[-1][0]] or size <= SAME * diagonals[bins[-1][-1]]):
            bins[-1].append(number)
        else:
            bins.append([number])
    named: dict[str, NDArray[np.intp]] = {}
    for members in bins:
        low, high = (f"{100 * diagonals[number]:.3g}" for number in (members[0], members[-1]))
        named[f"{low} cm" if low == high else f"{low} to {high} cm"] = np.array(members)
    return named


def _table(title: str, grouping: str, entries: Sequence[tuple[str, Tally]], *, by_direction: bool) -> Table:
    """Tabulate parts of a dataset."""
    rows = []
    for name, entry in entries:
        held, touched = np.concatenate(entry.held), np.concatenate(entry.touched)
        cells = [len(entry.held), len(held), float(touched.sum(axis=1).mean()), 100 * float(held.mean())]
        if by_direction:
            directions = np.concatenate(entry.held_directions)
            cells += [100 * float(directions.all(axis=1).mean()), *(100 * directions.mean(axis=0)).tolist()]
        rows.append(Row([name, *cells]))
    columns = [grouping, "objects", "grasps", "touches per grasp", "% that hold", *(("% in all", *DIRECTIONS) if by_direction else ())]
    formats = ["", "", "", ".2f", ".1f", *([".1f"] * 7 if by_direction else ())]
    return Table(title, columns, rows, formats)

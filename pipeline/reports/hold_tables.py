"""Tables of the hold test: which kept grasps hold the object, by class, by the object's size and by the direction of gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Row, Table
from pipeline.dataset.touch_statistics import Tally

SIZES = 5
"""Bins of size at most, with about as many objects each."""
MIN_RATIO = 1.05
"""Of a bin's upper end to its lower one at least: objects that were scaled to one size fill one bin."""
DIRECTIONS = ("−x", "+x", "−y", "+y", "−z", "+z")
"""Of gravity, as in `held_directions`."""


def hold_tables(tallies: Mapping[str, Tally]) -> list[Table]:
    """Make the tables, beside the touches; none for a dataset whose grasps were not tested.

    Parameters
    ----------
    tallies
        By class.
    """
    everything = Tally.joined(tallies.values())
    if not everything.lifted:
        return []
    by_size = [(name, everything.part(numbers)) for name, numbers in size_bins(np.array(everything.diagonals)).items()]
    parts = {"class": [*tallies.items(), ("all", everything)], "diagonal": by_size}
    titles = {"class": "Kept grasps that hold the object, by class", "diagonal": "The same, by the diagonal of the object's bounding box"}
    return [_table(titles[first], first, entries, by_direction=bool(everything.directions)) for first, entries in parts.items()]


def size_bins(diagonals: NDArray[np.float64]) -> dict[str, NDArray[np.intp]]:
    """Sort objects into bins of size whose ends are the data's.

    Parameters
    ----------
    diagonals
        (N,) m.

    Returns
    -------
    Numbers of the objects of each bin, by its name, from small to large.
    """
    order = np.argsort(diagonals, kind="stable")
    bins: list[list[int]] = []
    for part in np.array_split(order, min(SIZES, len(order))):
        for number in part.tolist():
            if bins and diagonals[number] < MIN_RATIO * diagonals[bins[-1][0]]:
                bins[-1].append(number)  # hardly larger than the bin's first
            elif number == part[0] or not bins:
                bins.append([number])
            else:
                bins[-1].append(number)
    named: dict[str, NDArray[np.intp]] = {}
    for own in bins:
        low, high = (f"{100 * diagonals[number]:.3g}" for number in (own[0], own[-1]))
        named[f"{low} cm" if low == high else f"{low} to {high} cm"] = np.array(own)
    return named


def _table(title: str, first: str, entries: Sequence[tuple[str, Tally]], *, by_direction: bool) -> Table:
    """Tabulate parts of a dataset."""
    rows = []
    for name, entry in entries:
        held, touched = np.concatenate(entry.lifted), np.concatenate(entry.touched)
        cells = [len(entry.lifted), len(held), float(touched.sum(axis=1).mean()), 100 * float(held.mean())]
        if by_direction:
            directions = np.concatenate(entry.directions)
            cells += [100 * float(directions.all(axis=1).mean()), *(100 * directions.mean(axis=0)).tolist()]
        rows.append(Row([name, *cells]))
    columns = [first, "objects", "grasps", "touches per grasp", "% that hold", *(("% in all", *DIRECTIONS) if by_direction else ())]
    formats = ["", "", "", ".2f", ".1f", *([".1f"] * 7 if by_direction else ())]
    return Table(title, columns, rows, formats)

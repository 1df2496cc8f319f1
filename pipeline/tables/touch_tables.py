"""Statistics of a dataset's grasps, beside Table 1 and section 1.6 of the supplement, and of the hold test."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipeline.config.manifest import TOTAL
from pipeline.console import Columns, Row, Table, tabulate
from pipeline.dataset.touch_statistics import PAPER, SUPPLEMENT_SUCCESS, Tally

SUPPLEMENT_HISTOGRAM = (9.47, 26.08, 53.83, 10.61)
"""Section 1.6: per cent of grasps with 1 to 4 successful touches."""
OPPOSED = 90
"""Degrees between the normals of two contacts, above which they press against each other."""
SIZES = 5
"""Maximum number of size bins; each but the last has an equal share of the objects."""
MIN_RATIO, SAME = 1.05, 1 + 1e-6
"""Least ratio of the lower ends of successive bins; and ratio up to which sizes are equal, as those of objects scaled to one size."""
DIRECTIONS = ("−x", "+x", "−y", "+y", "−z", "+z")
"""Directions of gravity, as in `held_directions`."""


def touch_tables(
    tallies: Mapping[str, Tally],  # by class
    sensors: Sequence[str],  # names
    *,
    paper: bool,  # put the paper's figures beside ours; touches per grasp only for the same number of sensors
) -> list[Table]:
    """Make the tables of touches, contacts and the hold test by class, then of touches per grasp and per sensor."""
    total = Tally.joined(tallies.values())
    groups = {**tallies, TOTAL: total}
    columns: Columns = {
        "objects": ("", lambda name: len(groups[name].touched)),
        "grasps": ("", lambda name: len(_kept(groups[name]))),
        "touches": ("", lambda name: _kept(groups[name]).size),
        "% successful": (".1f", lambda name: 100 * float(_kept(groups[name]).mean())),
    }
    if paper:
        columns[f"% in {PAPER}"] = ("", SUPPLEMENT_SUCCESS.get)
    columns["% of attempts, mean over objects"] = (".1f", lambda name: 100 * float(np.mean(groups[name].tried)))
    tables = [tabulate("Table 1: touches, all splits", "class", {name: name for name in groups}, columns)]
    if total.hold_measures:  # area, mm², angle between contacts, and margin of force closure
        measures: Columns = {
            "area of contact per grasp, mm²": (".0f", lambda tally: _measures(tally)[:, 0].mean()),
            f"% with contacts over {OPPOSED}° apart": (".1f", lambda tally: 100 * (_measures(tally)[:, 1] > OPPOSED).mean()),
            "% with force closure": (".1f", lambda tally: 100 * (_measures(tally)[:, 2] > 0).mean()),
        }
        tables.append(tabulate("Contacts", "class", groups, measures))
    tables += hold_tables(tallies)
    shares = touches_per_grasp(_kept(total))
    rows = [Row(["here", *_rounded(shares)])]
    if paper and (supplement := supplement_touches(len(shares))):
        rows.append(Row([PAPER, None, *_rounded(supplement[1:])]))
    tables.append(Table("Grasps by their number of successful touches, %", ["touches", *map(str, range(len(shares)))], rows))
    shares_of = {"kept": _kept(total).mean(axis=0), "attempts, mean over objects": np.mean(total.tried, axis=0)}
    rows = [Row([name, *_rounded(100 * values)]) for name, values in shares_of.items()]
    return [*tables, Table("Successful touches of each sensor, %", ["grasps", *sensors], rows)]


def _kept(tally: Tally) -> NDArray[np.bool_]:  # (grasp, sensor)
    return np.concatenate(tally.touched)


def _measures(tally: Tally) -> NDArray[np.float64]:  # (grasp, 3)
    return np.concatenate(tally.hold_measures)


def touches_per_grasp(
    touched: NDArray[np.bool_],  # (grasp, sensor)
) -> NDArray[np.float64]:  # (1 + sensor,)
    """Compute the per cent of grasps with 0, 1, … successful touches."""
    return np.asarray(100 * np.bincount(touched.sum(axis=1), minlength=touched.shape[1] + 1) / len(touched))


def supplement_touches(count: int) -> tuple[float, ...]:
    """Give the supplement's per cent of grasps with 0, 1, … touches; empty for another number of sensors."""
    return (0.0, *SUPPLEMENT_HISTOGRAM) if count == 1 + len(SUPPLEMENT_HISTOGRAM) else ()


def _rounded(shares: Iterable[float]) -> list[str]:
    return [f"{share:.1f}" for share in shares]


def hold_tables(tallies: Mapping[str, Tally]) -> list[Table]:
    """Tabulate which kept grasps hold the object, by class and by the object's size; none for grasps that were not tested."""
    total = Tally.joined(tallies.values())
    if not total.held:
        return []
    columns: Columns = {
        "objects": ("", lambda tally: len(tally.held)),
        "grasps": ("", lambda tally: len(np.concatenate(tally.held))),
        "touches per grasp": (".2f", lambda tally: float(_kept(tally).sum(axis=1).mean())),
        "% that hold": (".1f", lambda tally: 100 * float(np.concatenate(tally.held).mean())),
    }
    if total.held_directions:
        columns["% in all"] = (".1f", lambda tally: 100 * float(np.concatenate(tally.held_directions).all(axis=1).mean()))
        for number, name in enumerate(DIRECTIONS):
            columns[name] = (".1f", partial(_share_held, number))
    by_size = {name: total.part(numbers) for name, numbers in size_bins(np.array(total.diagonals)).items()}
    return [
        tabulate("Kept grasps that hold the object, by class", "class", {**tallies, TOTAL: total}, columns),
        tabulate("The same, by the diagonal of the object's bounding box", "diagonal", by_size, columns),
    ]


def _share_held(direction: int, tally: Tally) -> float:
    return 100 * float(np.concatenate(tally.held_directions)[:, direction].mean())


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

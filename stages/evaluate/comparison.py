"""Scores that may be compared with an evaluation, and the figures of both."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pipeline.console import Table, abbreviate, pluralise
from stages.evaluate.baselines import BASELINE_PREFIX
from stages.evaluate.evaluation_files import Figures, read_figures, read_root, read_table
from stages.evaluate.settings import SHIPPED_ROWS

COMPARED = ("points", "tau", "scale", "rings")
"""Settings that figures in one table share."""


def difference(folder: Path, other: Path) -> str | None:
    """Name a difference between two evaluations that rules out a comparison: a setting, the seed or the objects; None if there is none."""
    ours, theirs = read_root(folder), read_root(other)
    for name in COMPARED:
        if ours["settings"][name] != theirs["settings"].get(name):
            return f"{name}={theirs['settings'].get(name)}, not {ours['settings'][name]}"
    if ours["seed"] != theirs["seed"]:
        return f"seed {theirs['seed']}, not {ours['seed']}"
    our_ids, their_ids = (read_table(place, "objects")["object_id"].tolist() for place in (folder, other))
    return None if our_ids == their_ids else f"other objects ({abbreviate(sorted({*our_ids} ^ {*their_ids}) or their_ids)})"


def beside(folder: Path, scored: Sequence[Path]) -> tuple[dict[str, Any], dict[str, Figures], list[Table]]:
    """Read the figures of an evaluation and of the scores that may be compared with it.

    Scores with another setting, seed or other objects are left out. Of each number of grasps, only the first grasps that all have are kept:
    one grasp tells more than another.

    Returns
    -------
    The inputs of each network and method, by name; the figures by name, with those of the baselines; and what was left out, in words.
    """
    inputs_by_name, figures = dict(read_root(folder)["configurations"]), read_figures(folder)
    for place in scored:
        if difference(folder, place) is None:
            theirs = read_figures(place)
            for name, inputs in read_root(place)["configurations"].items():
                label = f"{name}, scored" if name in inputs_by_name else name
                inputs_by_name[label], figures[label] = inputs, theirs[name]
                figures = {**{other: theirs[other] for other in theirs if other.startswith(BASELINE_PREFIX)}, **figures}
    common = _common_firsts([figures[name] for name in inputs_by_name])
    remarks = [
        Table(f"With {pluralise(number, 'grasp')}: of first grasp {_listed(firsts)} alone, which all rows have.")
        for number, firsts in common.items()
    ]
    figures |= {name: figures[name].only(common) for name in inputs_by_name}
    return inputs_by_name, figures, [*_left_out(folder, scored), *remarks]


def _common_firsts(networks: Sequence[Figures]) -> dict[int, set[int]]:
    """Find the first grasps that all have, by number of grasps, where some have others too; where they have none in common, all stay."""
    common = {}
    for number in sorted({number for figures in networks for number in figures.grasps}):
        firsts = [figures.firsts(number) for figures in networks if number in figures.grasps]
        shared = set.intersection(*firsts)
        if shared and any(shared < have for have in firsts):
            common[number] = shared
    return common


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))


def _left_out(folder: Path, scored: Sequence[Path]) -> Iterator[Table]:
    """Name the scores that may not be compared with an evaluation, and why."""
    for place in scored:
        if problem := difference(folder, place):
            yield Table(f"Scored with {problem}, and left out: {', '.join(read_root(place)['configurations'])}; score again")


def about_shipped(folders: Sequence[Path]) -> Iterator[Table]:
    """Describe how the rows of the network that ships differ from those beside them."""
    for settings in (read_root(folder)["settings"] for folder in folders):
        if "learned_from" in settings:
            learned = settings["learned_from"]
            known = f"; it has learned from {len(learned)} of these objects ({abbreviate(learned)})" if learned else ""
            yield Table(f"{SHIPPED_ROWS}…: the network that ships, given the first grasp of each object alone{known}.")

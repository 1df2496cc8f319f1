"""Scores that may be compared with an evaluation, and the figures of both."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pipeline.console import Table, abbreviate
from stages.evaluate.baselines import BASELINE_PREFIX
from stages.evaluate.evaluation_files import SHIPPED_ROWS, Figures, read_figures, read_root, read_table

COMPARED = ("points", "tau", "scale", "rings")
"""Settings that figures in one table share."""


def difference(folder: Path, other: Path) -> str | None:
    """Name what makes two evaluations not comparable: a setting, the seed or the objects; None if they are."""
    ours, theirs = read_root(folder), read_root(other)
    for name in COMPARED:
        if ours["settings"][name] != theirs["settings"].get(name):
            return f"{name}={theirs['settings'].get(name)}, not {ours['settings'][name]}"
    if ours["seed"] != theirs["seed"]:
        return f"seed {theirs['seed']}, not {ours['seed']}"
    our_ids, their_ids = (read_table(path, "objects")["object_id"].tolist() for path in (folder, other))
    return None if our_ids == their_ids else f"other objects ({abbreviate(sorted({*our_ids} ^ {*their_ids}) or their_ids)})"


def comparable_figures(
    folder: Path,
    scored: Sequence[Path],
) -> tuple[dict[str, Any], dict[str, Figures], set[int] | None]:  # inputs by name, figures by name, first grasps
    """Read the figures of an evaluation, with its baselines, and of the scores of the same objects, settings and seed.

    Those of networks and methods are restricted to the first grasps that all of them have, as one grasp tells more than
    another. These are None if all have the same; without a common one, all figures are kept.
    """
    inputs_by_name, figures = dict(read_root(folder)["configurations"]), read_figures(folder)
    for other in scored:
        if difference(folder, other) is None:
            theirs = read_figures(other)
            for name, inputs in read_root(other)["configurations"].items():
                label = f"{name}, scored" if name in inputs_by_name else name
                inputs_by_name[label], figures[label] = inputs, theirs[name]
                figures = {**{key: theirs[key] for key in theirs if key.startswith(BASELINE_PREFIX)}, **figures}
    common = _common_firsts([figures[name] for name in inputs_by_name])
    if common:
        figures |= {name: figures[name].only(common) for name in inputs_by_name}
    return inputs_by_name, figures, common


def _common_firsts(networks: Sequence[Figures]) -> set[int] | None:
    """Intersect the first grasps that networks have with each number of grasps; None if all have the same."""
    firsts = [figures.firsts(number) for figures in networks for number in figures.grasps]
    common = set.intersection(*firsts)
    return None if all(have == common for have in firsts) else common


def about_rows(folder: Path, scored: Sequence[Path], common: set[int] | None) -> Iterator[Table]:
    """Name the scores that are not comparable, the first grasps that all rows are of, and what the pretrained network was given."""
    for other in scored:
        if problem := difference(folder, other):
            yield Table(f"Not comparable, scored with {problem}: {', '.join(read_root(other)['configurations'])}; score again")
    if common:
        yield Table(f"All networks and methods with first grasp {', '.join(map(str, sorted(common)))} only, which each of them has.")
    elif common is not None:
        yield Table("Rows are of different first grasps, none of which all have: they cannot be compared well.")
    for settings in (read_root(other)["settings"] for other in (folder, *scored)):
        if "learned_from" in settings:
            learned = settings["learned_from"]
            known = f"; it was trained on {len(learned)} of these objects ({abbreviate(learned)})" if learned else ""
            yield Table(f"{SHIPPED_ROWS}…: the pretrained network, given the first grasp of each object alone{known}.")

"""Evaluations that may be compared: scores of other methods beside an evaluation, and evaluations of several trainings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Table, abbreviate
from pipeline.errors import StoreError
from pipeline.models.families import ROWS
from pipeline.store.directory import DataDirectory
from pipeline.store.validate import check_origins
from stages.evaluate.baselines import BASELINE_PREFIX
from stages.evaluate.evaluation_files import SHIPPED_ROWS, SHIPPED_SCORES, Figures, read_figures, read_root, read_table
from stages.evaluate.scores import shipped_digest

COMPARED = ("points", "tau", "scale", "rings")  # settings that figures in one table share
MAY_DIFFER = ("training_seed", "configurations")  # settings in which evaluations of several trainings may differ
Trainings = dict[str, dict[int, Figures]]  # by configuration, the figures of each of its trainings, by seed


def difference(folder: Path, other: Path, settings: Iterable[str] = COMPARED) -> str | None:
    """Name what makes two evaluations not comparable: one of these settings, the seed or the objects; None if they are."""
    ours, theirs = read_root(folder), read_root(other)
    for name in settings:
        our, their = (root["settings"].get(name) for root in (ours, theirs))
        if our != their:
            return f"{name}={their}, not {our}"
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
    firsts = [figures[name].firsts(number) for name in inputs_by_name for number in figures[name].grasps]
    common = set.intersection(*firsts)
    if all(grasps == common for grasps in firsts):
        return inputs_by_name, figures, None
    if common:
        figures |= {name: figures[name].only(common) for name in inputs_by_name}
    return inputs_by_name, figures, common


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
            differs = "".join(f"; {remark}" for remark in settings.get("not_learned", ()))
            yield Table(
                f"{SHIPPED_ROWS}…: the pretrained network {_network(settings)}, given the first grasp of each object alone{known}{differs}."
            )


def scores(directory: DataDirectory) -> dict[str, str | None]:
    """List the scores in a data directory, with the reason if one is out of date."""
    return {name: _outdated(directory, name) for name in directory.folders() if name.startswith("scores/")}


def _outdated(directory: DataDirectory, name: str) -> str | None:
    try:
        check_origins(directory, [name])
        settings = read_root(directory.verified_folder(name))["settings"]
    except StoreError as error:
        return str(error)
    other_weights = name == SHIPPED_SCORES and settings["weights"] != shipped_digest(_network(settings))
    return "the pretrained network is another now; measure it with `report --shipped`" if other_weights else None


def _network(settings: Mapping[str, Any]) -> str:
    """Name the pretrained network of a score."""
    return ROWS[settings["configurations"][0]].network


def read_values(folders: Sequence[Path]) -> Trainings:
    """Read the values per object of evaluations; raise a `StoreError` if their objects or settings differ."""
    values: Trainings = {}
    first = read_root(folders[0])
    for folder in folders:
        root = read_root(folder)
        if problem := difference(folders[0], folder, sorted({*first["settings"], *root["settings"]} - set(MAY_DIFFER))):
            raise StoreError(f"{folder} was made with {problem}, as {folders[0]}; run evaluate for each training seed, with one setting")
        figures = read_figures(folder)
        for name in root["configurations"]:
            if name not in figures:
                raise StoreError(f"{folder} has no figures of {name}, which it lists; run evaluate again")
            values.setdefault(name, {})[root["settings"]["training_seed"]] = figures[name]
    return values


def chamfer_of(trainings: Iterable[Figures], grasps: int) -> NDArray[np.float64]:
    """Compute the (training, object) Chamfer distances with a number of `grasps`, m²."""
    return np.stack([figures.per_object("chamfer", grasps) for figures in trainings])

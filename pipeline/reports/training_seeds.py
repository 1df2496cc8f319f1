"""Evaluations of networks that were trained several times, with other chance each time, read and printed as one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from pipeline.console import print_table
from pipeline.errors import StoreError
from pipeline.kernels.metrics.bootstrap import mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.models.families import EVERY_CONFIGURATION
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import names_in
from stages.evaluate.evaluation_files import Arrays, evaluation_name, has_table, read_root, read_table
from stages.evaluate.printed_tables import NONE, QUALITY_UNITS
from stages.evaluate.tables import ALL, per_object

OF_ONE = ("training_seed", "configurations")
"""Settings in which evaluations of one report may differ."""

Values = dict[str, list[Arrays]]
"""By configuration, the group `values` of each of its trainings."""


def evaluations(directory: DataDirectory) -> list[str]:
    """Name the evaluations of a data directory, that of training seed 0 first."""
    found = [re.fullmatch(r"evaluation(?:-seed-(\d+))?\.json", name) for name in names_in(directory.root)]
    return [evaluation_name(seed) for seed in sorted(int(match[1] or 0) for match in found if match)]


def read_values(folders: Sequence[Path]) -> Values:
    """Read the values per object of evaluations; a `StoreError` where they are not of the same objects, or measured otherwise."""
    found: Values = {}
    objects, settings = read_table(folders[0], "objects")["object_id"].tolist(), read_root(folders[0])["settings"]
    for folder in folders:
        theirs = read_root(folder)["settings"]
        names = sorted((settings.keys() | theirs.keys()) - set(OF_ONE))
        if name := next((name for name in names if theirs.get(name) != settings.get(name)), None):
            said = f"{folders[0]} was made with {name}={settings.get(name)}, {folder} with {name}={theirs.get(name)}"
            raise StoreError(f"{said}; run evaluate again for each training seed with the same settings")
        if read_table(folder, "objects")["object_id"].tolist() != objects:
            raise StoreError(f"{folder} and {folders[0]} evaluate different objects; run evaluate again for each training seed")
        for name in read_root(folder)["configurations"]:
            found.setdefault(name, []).append(read_table(folder, f"values/{name}"))
    return found


def chamfer_of(trainings: Sequence[Arrays], given: int) -> NDArray[np.float64]:
    """Compute the (training, object) Chamfer distances with `given` grasps, m²."""
    return np.stack([per_object(values, given) for values in trainings])


def show_trainings(folders: Sequence[Path], console: Console) -> None:
    """Print a row per configuration: how near it comes, beside a training object that is looked up, and how its surfaces look."""
    values = read_values(folders)
    counts = set(map(len, values.values()))
    seeds, uneven = max(counts), len(counts) > 1
    columns = ("model", "mean", "each training", "median", "most grasps", "looked up", *(label for label, _ in QUALITY_UNITS.values()))
    title = (
        f"Chamfer distance × {TABLE_3_FACTOR:.0f} with one grasp, {seeds} training{'s' * (seeds > 1)} of each network"
        f"{' at most' * uneven}; intervals over objects and trainings; surfaces: medians over objects"
    )
    print_table(console, columns, _rows(values, folders[0]), title)
    console.print(
        "looked up: mean and median of a training object chosen by what the network is given, image, touch, or nothing; "
        "red where the network is not nearer"
    )


def _rows(values: Values, folder: Path) -> Iterator[Sequence[object]]:
    seed = read_root(folder)["seed"]
    for name, trainings in values.items():
        one = TABLE_3_FACTOR * chamfer_of(trainings, 1)
        between = mean_interval(one, numpy_rng(seed, "trainings", name))
        median = float(np.median(one, axis=1).mean())
        given = int(trainings[0]["grasps_given"][-1])
        most = f"{TABLE_3_FACTOR * chamfer_of(trainings, given).mean():.3f}" if EVERY_CONFIGURATION[name].touch and given > 1 else NONE
        each = ", ".join(f"{mean:.2f}" for mean in one.mean(axis=1))
        surfaces = (
            f"{factor * np.mean([np.median(training[measure]) for training in trainings]):.3g}"
            for measure, (_, factor) in QUALITY_UNITS.items()
        )
        interval = f"\n[dim]({between.low:.3f}–{between.high:.3f})[/]" if np.isfinite(between.low) else ""
        looked_up = _looked_up(folder, name, between.mean, median)
        yield name, f"{between.mean:.3f}{interval}", each, f"{median:.3f}", most, looked_up, *surfaces


def _looked_up(folder: Path, name: str, mean: float, median: float) -> str:
    """Format the baseline that is given what the network is given, in red where the network is not nearer."""
    config = EVERY_CONFIGURATION[name]
    baseline = "by silhouette" if config.image else "by touch" if config.touch else "typical"
    table = read_table(folder, "baselines") if has_table(folder, "baselines") else {"baseline": np.array([])}
    if baseline not in table["baseline"]:
        return NONE
    place = (table["baseline"].tolist().index(baseline), table["category"].tolist().index(ALL))
    pairs = ((mean, TABLE_3_FACTOR * table["chamfer"][place]), (median, TABLE_3_FACTOR * table["median"][place]))
    return " / ".join(f"{theirs:.3f}" if ours < theirs else f"[red]{theirs:.3f}[/]" for ours, theirs in pairs)

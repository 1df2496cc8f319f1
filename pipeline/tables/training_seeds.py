"""Read and tabulate evaluations of several training seeds together."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Row, Table
from pipeline.errors import StoreError
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.models.families import ROWS
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from pipeline.store.validate import check_origins
from pipeline.tables.evaluation_tables import QUALITY_UNITS
from stages.evaluate.baselines import retrieved_by
from stages.evaluate.evaluation_files import SHIPPED_SCORES, Figures, read_figures, read_root, read_table
from stages.evaluate.shipped import shipped_digest

MAY_DIFFER = ("training_seed", "configurations")
"""Settings in which evaluations of one report may differ."""

Values = dict[str, dict[int, Figures]]
"""By configuration, the figures of each of its trainings, by seed."""


def scores(directory: DataDirectory) -> list[str]:
    """Name the scores of other methods in a data directory that were made from the current inputs."""
    return [name for name, problem in _scored(directory) if problem is None]


def outdated_scores(directory: DataDirectory) -> dict[str, str]:
    """List the scores that are out of date, with the reasons."""
    return {name: problem for name, problem in _scored(directory) if problem is not None}


def _scored(directory: DataDirectory) -> Iterator[tuple[str, str | None]]:
    for name in directory.folders():
        if name.startswith("scores/"):
            try:
                check_origins(directory, [name])
                settings = read_root(directory.verified_folder(name))["settings"]
            except StoreError as error:
                yield name, str(error)
            else:
                outdated = name == SHIPPED_SCORES and settings["weights"] != shipped_digest()
                yield name, "the pretrained network is another now; measure it with `report --shipped`" if outdated else None


def read_values(folders: Sequence[Path]) -> Values:
    """Read the values per object of evaluations; raise a `StoreError` if their objects or settings differ."""
    values: Values = {}
    objects, settings = read_table(folders[0], "objects")["object_id"].tolist(), read_root(folders[0])["settings"]
    for folder in folders:
        theirs = read_root(folder)["settings"]
        names = sorted((settings.keys() | theirs.keys()) - set(MAY_DIFFER))
        if name := next((name for name in names if theirs.get(name) != settings.get(name)), None):
            differ = f"{folders[0]} was made with {name}={settings.get(name)}, {folder} with {name}={theirs.get(name)}"
            raise StoreError(f"{differ}; run evaluate again for each training seed with the same settings")
        if read_table(folder, "objects")["object_id"].tolist() != objects:
            raise StoreError(f"{folder} and {folders[0]} evaluate different objects; run evaluate again for each training seed")
        figures = read_figures(folder)
        for name in read_root(folder)["configurations"]:
            if name not in figures:
                raise StoreError(f"{folder} has no figures of {name}, which it lists; run evaluate again")
            values.setdefault(name, {})[theirs["training_seed"]] = figures[name]
    return values


def chamfer_of(trainings: Iterable[Figures], grasps: int) -> NDArray[np.float64]:
    """Compute the (training, object) Chamfer distances with a number of `grasps`, m²."""
    return np.stack([figures.per_object("chamfer", grasps) for figures in trainings])


def trainings_table(folders: Sequence[Path]) -> list[Table]:
    """Make the table of all trainings: a row per configuration, with its errors, those of a baseline, and its surfaces."""
    values = read_values(folders)
    counts = set(map(len, values.values()))
    seeds, uneven = max(counts), len(counts) > 1
    columns = ["model", "mean", "each training", "median", "most grasps", "baseline", *(label for label, _ in QUALITY_UNITS.values())]
    title = (
        f"Chamfer distance × {TABLE_3_FACTOR:.0f}, m², with one grasp, whichever is the first, {seeds} training{'s' * (seeds > 1)} of each "
        f"network{' at most' * uneven}; intervals over objects and trainings; surfaces: medians over objects"
    )
    formats = ["", ".3f", ".2f", ".3f", ".3f", "", *[".3g"] * len(QUALITY_UNITS)]
    note = (
        "baseline: mean and median of a training object in place of the reconstruction, with an image the most similar silhouette "
        "without the hand, else the nearest to the touches of the first grasp, else a typical one; * where the network is not nearer"
    )
    return [Table(title, columns, list(_rows(values, folders[0])), formats), Table(note)]


def _rows(values: Values, folder: Path) -> Iterator[Row]:
    seed, figures_of = read_root(folder)["seed"], read_figures(folder)
    for name, by_seed in values.items():
        trainings = [*by_seed.values()]
        config, chamfer = ROWS[name].inputs, TABLE_3_FACTOR * chamfer_of(trainings, 1)
        interval: Interval = mean_interval(chamfer, numpy_rng(seed, "intervals"))
        median, most_grasps = float(np.median(chamfer, axis=1).mean()), trainings[0].grasps[-1]
        error_with_most = TABLE_3_FACTOR * float(chamfer_of(trainings, most_grasps).mean()) if config.touch and most_grasps > 1 else None
        qualities = (
            factor * float(np.mean([np.median(figures.available(measure)) for figures in trainings]))
            for measure, (_, factor) in QUALITY_UNITS.items()
        )
        baseline = figures_of.get(retrieved_by(config.image, config.touch))
        theirs = None if baseline is None else _baseline_cell(interval.mean, median, TABLE_3_FACTOR * baseline.per_object("chamfer"))
        per_training = ", ".join(f"{mean:.2f}" for mean in chamfer.mean(axis=1))
        yield Row([name, interval, per_training, median, error_with_most, theirs, *qualities])


def _baseline_cell(mean: float, median: float, theirs: NDArray[np.float64]) -> str:
    """Write mean and median of the baseline, marked if the network is not nearer."""
    pairs = ((mean, float(theirs.mean())), (median, float(np.median(theirs))))
    return " / ".join(f"{baseline:.3f}{'' if ours < baseline else ' *'}" for ours, baseline in pairs)

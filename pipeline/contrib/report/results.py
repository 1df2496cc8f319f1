"""Results: the tables of evaluations with scores beside them and of trainings, and a summary in a few sentences and one plot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import Cell, Row, Table, pluralise
from pipeline.contrib.report.orderings import orderings, orderings_table
from pipeline.errors import StoreError
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.networks.network_configurations import INPUT_CHOICES
from pipeline.models.families import ROWS
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import exists
from pipeline.store.validate import check_origins
from pipeline.tables.comparison import chamfer_of, comparable_figures, read_values
from pipeline.tables.evaluation_tables import QUALITY_UNITS, evaluation_tables
from pipeline.tables.supplement_figures import BEST_EPOCH, PAPER
from pipeline.tables.touch_tables import Touches, read_touches, touch_tables
from pipeline.training.checkpoint import METRICS, read_metrics
from schemas.grasps import GRASPS
from stages.evaluate.baselines import retrieved_by
from stages.evaluate.evaluation_files import read_figures, read_root, read_table

GIVEN = {
    "none": "nothing",
    "touch": "touch",
    "occluded": "occluded\nimage",
    "occluded-touch": "occluded,\ntouch",
    "unoccluded": "whole\nimage",
    "unoccluded-touch": "whole,\ntouch",
}
"""What networks are given, as the plot calls it, by the way of `INPUT_CHOICES`."""
COMPARED_WAYS = {
    "touch": "touch alone",
    "occluded-touch": "an image that the hand occludes and touch",
    "unoccluded": "an image of the whole object",
}
"""Inputs that the sentences compare, in words."""
DEFAULT_SERIES = "graph network"  # series of the networks that are named after their inputs


@dataclass(frozen=True)
class Results:
    """Current evaluations of a data directory, one per training seed, and scores of other methods, by name."""

    directory: DataDirectory
    evaluated: Sequence[str]
    scored: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_origins(self.directory, self.evaluated)

    @cached_property
    def touches(self) -> Touches:
        """The touches of all grasps."""
        return read_touches(self.directory.root)

    @cached_property
    def tables(self) -> list[Table]:
        """The tables of the evaluations, with the scores, and the table of trainings."""
        tables: list[Table] = []
        folders, scored_folders = ([self.directory.verified_folder(name) for name in names] for names in (self.evaluated, self.scored))
        if first := [*folders[:1], *scored_folders][:1]:
            tables += evaluation_tables(first[0], [folder for folder in scored_folders if folder != first[0]])
        if self.directory.collection(GRASPS).shards:
            tables += touch_tables(self.touches)[:1]
        if folders:
            tables += [*trainings_table(folders), *orderings_table(orderings(folders))]
        if models := trained_models(self.directory, self.evaluated):
            tables.append(training_table(self.directory, models))
        return tables


def trained_models(directory: DataDirectory, evaluated: Sequence[str]) -> dict[str, str]:
    """Find the trained models, the U-Net and those of the first evaluation: their folders by name."""
    names = ["models/unet", *(directory.folder(evaluated[0]).models if evaluated else ())]
    return {Path(name).name: name for name in names if exists(directory.folder_record(name))}


def training_table(directory: DataDirectory, models: Mapping[str, str]) -> Table:
    """List the training of each model, a folder by name: epochs, loss, time and hardware."""
    rows = []
    for name, folder in models.items():
        facts = directory.folder(folder).facts
        try:
            used = facts["hardware"]
            hardware = f"{used['device']}, {pluralise(used['processes'], 'process')} of {pluralise(used['threads'], 'thread')}"
            epochs = [facts["epochs"], facts["best_epoch"] + 1, BEST_EPOCH.get(name), facts["best"]["loss"]]
            cells = [name, facts["parameters"], *epochs, facts["training_seconds"], f"{hardware}, {used['precision']}"]
        except (KeyError, TypeError) as error:
            path = directory.folder_record(folder)
            raise StoreError(f"{path}: it lacks facts of a training ({error!r}); delete it and train the model again") from error
        rows.append(Row(cells))
    columns = ["model", "parameters", "epochs", "best epoch", f"best in {PAPER}", "validation loss", "seconds", "hardware"]
    return Table("Training", columns, rows, ["", ",", "", "", "", ".4g", ".0f", ""])


def training_losses(folder: Path) -> tuple[list[float], list[float]]:
    """Read the training and the validation loss of each epoch from a model's folder; raise a `StoreError` if they are missing."""
    try:
        epochs = read_metrics(folder)
        losses = [[float(epoch[name]) for epoch in epochs] for name in ("train_loss", "loss")]
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{folder}: {METRICS} lacks the losses of each epoch ({error!r}); train the model again") from error
    if not losses[0]:
        raise StoreError(f"{folder}: {METRICS} lacks the losses of each epoch: it is empty; train the model again")
    return losses[0], losses[1]


def trainings_table(folders: Sequence[Path]) -> list[Table]:
    """Make the table of all trainings: a row per configuration, with its errors, those of a baseline, and its surfaces."""
    values, seed, baselines = read_values(folders), read_root(folders[0])["seed"], read_figures(folders[0])
    counts = set(map(len, values.values()))
    title = (
        f"Chamfer distance × {TABLE_3_FACTOR:.0f}, m², with one grasp, whichever is the first, "
        f"{pluralise(max(counts), 'training')} of each network{' at most' * (len(counts) > 1)}; intervals over objects and trainings; "
        "surfaces: medians over objects"
    )
    rows = []
    for name, by_seed in values.items():
        trainings, inputs = [*by_seed.values()], ROWS[name].inputs
        chamfer = TABLE_3_FACTOR * chamfer_of(trainings, 1)
        interval: Interval = mean_interval(chamfer, numpy_rng(seed, "intervals"))
        median, most = float(np.median(chamfer, axis=1).mean()), trainings[0].grasps[-1]
        baseline = baselines.get(retrieved_by(inputs.image, inputs.touch))
        cells: list[Cell] = [interval, ", ".join(f"{mean:.2f}" for mean in chamfer.mean(axis=1)), median]
        cells.append(TABLE_3_FACTOR * float(chamfer_of(trainings, most).mean()) if inputs.touch and most > 1 else None)
        if baseline is None:
            cells.append(None)
        else:  # mean and median, marked if the network is not nearer
            theirs = TABLE_3_FACTOR * baseline.per_object("chamfer")
            pairs = ((interval.mean, float(theirs.mean())), (median, float(np.median(theirs))))
            cells.append(" / ".join(f"{other:.3f}{'' if ours < other else ' *'}" for ours, other in pairs))
        for measure, (_, factor) in QUALITY_UNITS.items():
            cells.append(factor * float(np.mean([np.median(figures.available(measure)) for figures in trainings])))
        rows.append(Row([name, *cells]))
    columns = ["model", "mean", "each training", "median", "most grasps", "baseline", *(label for label, _ in QUALITY_UNITS.values())]
    note = (
        "baseline: mean and median of a training object in place of the reconstruction, with an image the most similar silhouette "
        "without the hand, else the nearest to the touches of the first grasp, else a typical one; * where the network is not nearer"
    )
    return [Table(title, columns, rows, ["", ".3f", ".2f", ".3f", ".3f", "", *[".3g"] * len(QUALITY_UNITS)]), Table(note)]


@dataclass(frozen=True)
class Summary:
    """The results with one grasp."""

    sentences: list[str]  # three, for the report
    errors: Mapping[str, Mapping[str, Interval]]  # mean distances, mm, by series and by way of `INPUT_CHOICES`
    retrieved: Mapping[str, float]  # mean distance of a training object, mm, by way


def summarise(folder: Path, scored: Sequence[Path], further: Sequence[Path] = ()) -> Summary | None:
    """Summarise the results with one grasp of an evaluation or a score; None if there are none.

    `further` are evaluations of other trainings of its networks, `scored` scores of other methods.
    """
    network_inputs, figures, _ = comparable_figures(folder, scored)
    root = read_root(folder)
    seed, objects = root["seed"], len(read_table(folder, "objects")["object_id"])
    trainings = {name: [figures[name]] for name in network_inputs}
    for training in further:
        further_figures = comparable_figures(training, scored)[1]  # of the same grasps
        for name in trainings.keys() & read_root(training)["configurations"].keys():
            trainings[name].append(further_figures[name])
    errors: dict[str, dict[str, Interval]] = {}
    own = () if "method" in root["settings"] else root["configurations"]
    methods = {read_root(other)["settings"].get("method") for other in (folder, *scored)} - set(own)
    for name, way in _ways(network_inputs).items():
        if name in methods and name == way:  # it would be taken for a graph network
            continue
        if all(1 in network.grasps for network in trainings[name]):
            series = name.removesuffix(way).rstrip("-") or DEFAULT_SERIES
            values = 1e3 * np.stack([network.per_object("mean_distance") for network in trainings[name]])
            errors.setdefault(series, {})[way] = mean_interval(values, numpy_rng(seed, "intervals"))
    if not errors:
        return None
    ways = [way for way in INPUT_CHOICES if any(way in of_series for of_series in errors.values())]
    baselines = {way: figures.get(retrieved_by(INPUT_CHOICES[way].image, INPUT_CHOICES[way].touch)) for way in ways}
    retrieved = {way: 1e3 * float(item.per_object("mean_distance").mean()) for way, item in baselines.items() if item is not None}
    return Summary(_sentences(errors, retrieved, objects, root["training_objects"]), errors, retrieved)


def _ways(network_inputs: Mapping[str, Any]) -> dict[str, str]:
    """Find the way of `INPUT_CHOICES` that ends each network's name and is its input; skip other networks."""
    ways = {}
    for name, inputs in network_inputs.items():
        way = max((way for way in INPUT_CHOICES if f"-{name}".endswith(f"-{way}")), key=len, default=None)
        if way and (INPUT_CHOICES[way].image, INPUT_CHOICES[way].touch) == (inputs["image"], inputs["touch"]):
            ways[name] = way
    return ways


def _sentences(
    errors: Mapping[str, Mapping[str, Interval]], retrieved: Mapping[str, float], objects: int, training_objects: int
) -> list[str]:
    best: dict[str, tuple[Interval, str]] = {}
    for series, of_series in errors.items():
        for way, error in of_series.items():
            if way not in best or error.mean < best[way][0].mean:
                best[way] = error, series
    phrases = [f"{best[way][0].mean:.1f} mm with {words} ({best[way][1]})" for way, words in COMPARED_WAYS.items() if way in best]
    nearer = [
        (series, way) for series, of_series in errors.items() for way, error in of_series.items() if error.mean < retrieved.get(way, 0)
    ]
    compared = sum(way in retrieved for of_series in errors.values() for way in of_series)
    verb = "is" if 1 in (len(nearer), compared) else "are"
    return [
        f"Networks reconstructed {pluralise(objects, 'test object')} from one grasp each; the error is the mean distance between "
        "reconstruction and object.",
        f"The best are off by {_listed(phrases)}." if phrases else "The plot shows them by what they were given.",
        f"{len(nearer)} of {pluralise(compared, 'network')} {verb} nearer than one of "
        f"{pluralise(training_objects, 'training object')}, which the line shows: the most similar one by the silhouette without the "
        "hand, or else by the touches of the first grasp."
        if retrieved
        else "There is no training object to compare with.",
    ]


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"

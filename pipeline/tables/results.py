"""Tables of results: evaluations with scores beside them, and trainings."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from pipeline.console import Cell, Columns, Row, Table, pluralise, tabulate
from pipeline.errors import StoreError, first_line
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.models.families import ROWS
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import exists
from pipeline.tables.comparison import chamfer_of, read_values
from pipeline.tables.evaluation_tables import QUALITY_UNITS, evaluation_tables
from pipeline.tables.orderings import orderings, orderings_table
from pipeline.tables.supplement_figures import BEST_EPOCH, PAPER
from pipeline.tables.touch_tables import read_touches, touch_tables
from pipeline.training.checkpoint import METRICS, read_metrics
from schemas.grasps import GRASPS
from stages.evaluate.baselines import retrieved_by
from stages.evaluate.evaluation_files import read_figures, read_root


def results_tables(directory: DataDirectory, evaluated: Sequence[str], scored: Sequence[str] = ()) -> list[Table]:
    """Make the tables of evaluations, one name per training seed, with the scores of other methods, and the table of trainings."""
    tables: list[Table] = []
    folders, scored_folders = ([directory.verified_folder(name) for name in names] for names in (evaluated, scored))
    if first := [*folders[:1], *scored_folders][:1]:
        tables += evaluation_tables(first[0], [folder for folder in scored_folders if folder != first[0]])
    if directory.collection(GRASPS).shards:
        tables += touch_tables(read_touches(directory.root))[:1]
    if folders:
        tables += [*trainings_table(folders), *orderings_table(orderings(folders))]
    if models := trained_models(directory, evaluated):
        tables.append(training_table({name: training_facts(directory, folder) for name, folder in models.items()}))
    return tables


def trained_models(directory: DataDirectory, evaluated: Sequence[str]) -> dict[str, str]:
    """Find the trained models, the U-Net and those of the first evaluation: their folders by name."""
    names = ["models/unet", *(directory.folder(evaluated[0]).models if evaluated else ())]
    return {Path(name).name: name for name in names if exists(directory.folder_record(name))}


class _Hardware(BaseModel):
    device: str
    processes: int
    threads: int
    precision: str


class _Best(BaseModel):
    loss: float


class _Epoch(_Best):
    train_loss: float


class TrainingFacts(BaseModel):
    """Facts of a training that a report prints, in the record of the model."""

    parameters: int
    epochs: int
    best_epoch: int
    best: _Best
    training_seconds: float
    hardware: _Hardware


def training_facts(directory: DataDirectory, name: str) -> TrainingFacts:
    """Read the facts of a training from the record of its model; raise a `StoreError` if some are missing."""
    try:
        return TrainingFacts.model_validate(directory.folder(name).facts)
    except ValidationError as error:
        path = directory.folder_record(name)
        raise StoreError(f"{path}: it lacks facts of a training: {invalid_entries(error)}; delete it and train the model again") from error


def training_table(trained: Mapping[str, TrainingFacts]) -> Table:
    """List each model's training: epochs, loss, time and hardware, by name."""

    def hardware(name: str) -> str:
        used = trained[name].hardware
        return f"{used.device}, {pluralise(used.processes, 'process')} of {pluralise(used.threads, 'thread')}, {used.precision}"

    columns: Columns = {
        "parameters": (",", lambda name: trained[name].parameters),
        "epochs": ("", lambda name: trained[name].epochs),
        "best epoch": ("", lambda name: trained[name].best_epoch + 1),
        f"best in {PAPER}": ("", BEST_EPOCH.get),
        "validation loss": (".4g", lambda name: trained[name].best.loss),
        "seconds": (".0f", lambda name: trained[name].training_seconds),
        "hardware": ("", hardware),
    }
    return tabulate("Training", "model", {name: name for name in trained}, columns)


def training_losses(folder: Path) -> tuple[list[float], list[float]]:
    """Read the training and the validation loss of each epoch from a model's folder; raise a `StoreError` if they are missing."""
    try:
        epochs = TypeAdapter(Annotated[list[_Epoch], Field(min_length=1)]).validate_python(read_metrics(folder))
    except ValueError as error:  # pydantic's and those of JSON
        raise StoreError(f"{folder}: {METRICS} lacks the losses of each epoch ({first_line(error)}); train the model again") from error
    return [epoch.train_loss for epoch in epochs], [epoch.loss for epoch in epochs]


def trainings_table(folders: Sequence[Path]) -> list[Table]:
    """Make the table of all trainings: a row per configuration, with its errors, those of a baseline, and its surfaces."""
    values, seed, baselines = read_values(folders), read_root(folders[0])["seed"], read_figures(folders[0])
    counts = set(map(len, values.values()))
    title = (
        f"Chamfer distance × {TABLE_3_FACTOR:.0f}, m², with one grasp, whichever is the first, {max(counts)} "
        f"training{'s' * (max(counts) > 1)} of each network{' at most' * (len(counts) > 1)}; intervals over objects and trainings; "
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

"""Make tables of the results of evaluations and trainings."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from pipeline.console import Row, Table, pluralise
from pipeline.dataset.touch_statistics import PAPER
from pipeline.errors import StoreError, first_line
from pipeline.formats.description_file import invalid_entries
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import exists
from pipeline.tables.evaluation_tables import evaluation_tables
from pipeline.tables.orderings import orderings, orderings_table
from pipeline.tables.supplement_figures import BEST_EPOCH
from pipeline.tables.training_seeds import trainings_table
from pipeline.training.loop import METRICS, read_metrics


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
    columns = ["model", "parameters", "epochs", "best epoch", f"best in {PAPER}", "validation loss", "seconds", "hardware"]
    rows = []
    for name, facts in trained.items():
        ran = facts.hardware
        hardware = f"{ran.device}, {pluralise(ran.processes, 'process')} of {pluralise(ran.threads, 'thread')}, {ran.precision}"
        epochs = (facts.epochs, facts.best_epoch + 1, BEST_EPOCH.get(name))
        rows.append(Row([name, facts.parameters, *epochs, facts.best.loss, facts.training_seconds, hardware]))
    return Table("Training", columns, rows, ["", ",", "", "", "", ".4g", ".0f", ""])


class _Losses(BaseModel):
    """The losses of one epoch."""

    loss: float
    train_loss: float


def training_losses(folder: Path) -> tuple[list[float], list[float]]:
    """Read the training and the validation loss of each epoch from a model's folder; raise a `StoreError` if they are missing."""
    try:
        epochs = TypeAdapter(Annotated[list[_Losses], Field(min_length=1)]).validate_python(read_metrics(folder))
    except ValueError as error:  # pydantic's and those of JSON
        raise StoreError(f"{folder}: {METRICS} lacks the losses of each epoch ({first_line(error)}); train the model again") from error
    return [epoch.train_loss for epoch in epochs], [epoch.loss for epoch in epochs]


def results_tables(directory: DataDirectory, evaluated: Sequence[str], scored: Sequence[str] = ()) -> list[Table]:
    """Make the tables of evaluations, one name per training seed, with the scores of other methods, and the table of trainings."""
    tables: list[Table] = []
    folders, scored_folders = ([directory.verified_folder(name) for name in names] for names in (evaluated, scored))
    if first := [*folders[:1], *scored_folders][:1]:
        tables += evaluation_tables(first[0], [place for place in scored_folders if place != first[0]])
    if folders:
        tables += [*trainings_table(folders), *orderings_table(orderings(folders))]
    if models := trained_models(directory, evaluated):
        tables.append(training_table({name: training_facts(directory, place) for name, place in models.items()}))
    return tables

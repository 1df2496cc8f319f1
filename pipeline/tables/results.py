"""Make tables of the results of evaluations and trainings."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from pipeline.console import Columns, Table, pluralise, tabulate
from pipeline.errors import StoreError, first_line
from pipeline.formats.description_file import invalid_entries
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import exists
from pipeline.tables.evaluation_tables import evaluation_tables
from pipeline.tables.orderings import orderings, orderings_table
from pipeline.tables.supplement_figures import BEST_EPOCH, PAPER
from pipeline.tables.touch_tables import read_touches, touch_tables
from pipeline.tables.training_seeds import trainings_table
from pipeline.training.checkpoint import METRICS, read_metrics
from schemas.grasps import GRASPS


def trained_models(directory: DataDirectory, evaluated: Sequence[str]) -> dict[str, str]:
    """Find the trained models, the U-Net and those of the first evaluation: their folders by name."""
    names = ["models/unet", *(directory.folder(evaluated[0]).models if evaluated else ())]
    return {Path(name).name: name for name in names if exists(directory.folder_record(name))}


class _Hardware(BaseModel):
    device: str
    processes: int
    threads: int
    precision: str

    @property
    def text(self) -> str:
        return f"{self.device}, {pluralise(self.processes, 'process')} of {pluralise(self.threads, 'thread')}, {self.precision}"


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
    columns: Columns = {
        "parameters": (",", lambda name: trained[name].parameters),
        "epochs": ("", lambda name: trained[name].epochs),
        "best epoch": ("", lambda name: trained[name].best_epoch + 1),
        f"best in {PAPER}": ("", BEST_EPOCH.get),
        "validation loss": (".4g", lambda name: trained[name].best.loss),
        "seconds": (".0f", lambda name: trained[name].training_seconds),
        "hardware": ("", lambda name: trained[name].hardware.text),
    }
    return tabulate("Training", "model", {name: name for name in trained}, columns)


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
        tables += evaluation_tables(first[0], [folder for folder in scored_folders if folder != first[0]])
    if directory.collection(GRASPS).shards:
        tables += touch_tables(read_touches(directory.root))[:1]
    if folders:
        tables += [*trainings_table(folders), *orderings_table(orderings(folders))]
    if models := trained_models(directory, evaluated):
        tables.append(training_table({name: training_facts(directory, folder) for name, folder in models.items()}))
    return tables

"""Base classes of stages, and the types that pass between a stage and the engine."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rich.console import Console

from pipeline.config.settings import Settings
from pipeline.config.sources import Object
from pipeline.rng import numpy_rng
from pipeline.store.record import Failure
from pipeline.store.rows import Row
from pipeline.store.shard import RowView, Shard
from pipeline.store.storage import Location
from schemas.base import Artifact


@dataclass(frozen=True)
class Unit:
    """A unit of work: an object's row, or a folder."""

    name: str  # the object's id, or the folder's name
    key: str = ""  # hash of everything that it depends on
    inputs: dict[str, str] = field(default_factory=dict)  # digests of its inputs, by artifact
    seed: int = 0  # the root seed
    category: str = ""  # of an object, as in the manifest; so are `split` and `source`
    split: str = ""
    source: Mapping[str, Any] = field(default_factory=dict)
    failure: Failure | None = None  # why it cannot be processed: an input failed, or its file cannot be read

    def rng(self, *identity: str | int) -> np.random.Generator:
        """Make a random generator for this object and the given names (stage, attempt, …)."""
        return numpy_rng(self.seed, self.name, *identity)


@dataclass(frozen=True)
class Cost:
    """The typical cost of an object (in a dataset stage, of all objects) on one core, for `--dry-run`."""

    seconds: float
    kilobytes: float


Inputs = Mapping[str, RowView]  # an object's rows of a stage's inputs, by artifact; `attributes` of each are those of its shard's root


class Stage(ABC):
    """The base class of all stages. A stage derives from `ObjectStage` or `DatasetStage`."""

    name: ClassVar[str]
    summary: ClassVar[str]
    settings_type: ClassVar[type[Settings]]
    per_object: ClassVar[bool]  # whether it makes shards of rows; else it fills one folder
    trains: ClassVar[bool] = False  # whether it is a training

    def inputs(self, settings: Any) -> tuple[Artifact, ...]:
        """Return the artifacts that are read; by default none."""
        return ()

    def models(self, settings: Any) -> tuple[str, ...]:
        """Name the folders below the data directory that are read, such as `models/unet`; by default none."""
        return ()

    def assets(self, settings: Any) -> list[Path]:
        """List data files whose content belongs to the key (a hand, a sensor, a scene); by default none."""
        return []

    def reads(self, settings: Any) -> list[str]:
        """Name the artifacts and folders that are read."""
        return [*(artifact.name for artifact in self.inputs(settings)), *self.models(settings)]

    @abstractmethod
    def writes(self, settings: Any) -> str:
        """Name the artifact or folder that is made, below the data directory."""

    def describe_objects(self, settings: Any, objects: Sequence[Object]) -> Iterable[str]:
        """Report how a run reads the manifest's objects; by default nothing."""
        return ()

    @abstractmethod
    def cost_of(self, settings: Any, items: Sequence[Object]) -> tuple[int, Cost]:
        """Count the objects of these that are read, and estimate their total cost on one core."""


class ObjectStage(Stage):
    """A stage that turns one object's row of its inputs into one row of its output."""

    output: ClassVar[Artifact]
    per_object = True

    def resolve_settings(self, settings: Any, attributes: Mapping[str, Mapping[str, Any]]) -> Any:
        """Fill in null settings that follow the inputs, from the attributes of the inputs' roots; by default there are none."""
        return settings

    def check_inputs(self, settings: Any, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """Refuse inputs whose roots' attributes do not fit these settings: an `InvalidInput` says how to make them fit."""

    def describe_misfits(self, settings: Any, objects: Iterable[tuple[str, Inputs]]) -> Iterable[str]:
        """Report, before a run, which of these objects (name and inputs), or parts of the hand, do not fit; by default nothing."""
        return ()

    def describe_shard(self, settings: Any, shard: Shard) -> Iterable[str]:
        """Report on a finished shard; by default nothing."""
        return ()

    def files(self, settings: Any, item: Object) -> list[Path]:
        """List the files of an object that are read beside the inputs' rows; their content belongs to the key. By default none."""
        return []

    def constants(self, settings: Any) -> Row:
        """Compute the output's arrays that have no object dimension; labels of dimensions that an input has need not be given."""
        return {}

    def attributes(self, settings: Any) -> dict[str, Any]:
        """Return further attributes of the output's root (a sensor's description), as JSON."""
        return {}

    def writes(self, settings: Any) -> str:
        """Return the artifact's name."""
        return self.output.name

    @abstractmethod
    def cost(self, settings: Any) -> Cost:
        """Estimate the cost of an object."""

    def cost_of(self, settings: Any, items: Sequence[Object]) -> tuple[int, Cost]:
        """Add up the cost of all objects."""
        cost = self.cost(settings)
        return len(items), Cost(cost.seconds * len(items), cost.kilobytes * len(items))

    def session(self, settings: Any, models: Mapping[str, Path]) -> AbstractContextManager[Callable[[Unit, Inputs], Row]]:
        """Open what a worker keeps between objects (a renderer, a physics client); yield `process(unit, inputs) -> row`.

        By default nothing is kept, and `process` makes the row. An `InvalidInput` is the object's failure, another exception a fault of
        the stage.
        """
        return nullcontext(partial(self.process, settings=settings))

    def process(self, unit: Unit, inputs: Inputs, settings: Any) -> Row:
        """Make an object's row; only for stages without a session of their own."""
        raise NotImplementedError


@dataclass(frozen=True)
class DatasetJob:
    """The job of a dataset stage: what to read, and the folder to fill.

    Once published, the folder is `name` below `data`. It may hold files of a killed run, which the stage may continue.
    Hidden files in it are kept until it is finished, then removed. Random numbers are keyed by `seed` and names, as
    `numpy_rng` takes them.
    """

    data: Location
    folder: Path
    settings: Any
    seed: int
    models: Mapping[str, Path]
    console: Console
    name: str


class DatasetStage(Stage):
    """A stage that reads the whole dataset and fills one folder: a trained model, an evaluation."""

    per_object = False

    @abstractmethod
    def splits(self, settings: Any) -> tuple[str, ...]:
        """Name the splits whose objects are read; the others change nothing."""

    def grid(self, settings: Any) -> Mapping[str, Sequence[Any]]:
        """Return the supplement's grid of hyperparameters, by setting; by default there is none."""
        return {}

    @abstractmethod
    def cost(self, settings: Any, objects: int) -> Cost:
        """Estimate the total cost with this number of objects in its splits."""

    def cost_of(self, settings: Any, items: Sequence[Object]) -> tuple[int, Cost]:
        """Count the objects of its splits, and estimate their cost."""
        number = sum(item.split in self.splits(settings) for item in items)
        return number, self.cost(settings, number)

    @abstractmethod
    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Fill the job's folder; return facts for its record (hardware, the best loss), as JSON."""


Changes = Mapping[str, Any]  # settings of a stage that differ from the user's, by name


@dataclass(frozen=True)
class Trade:
    """The settings of a stage that are worth varying, and how their error is measured."""

    metric: str  # what the error is
    unit: str  # its unit: "mm", "um" (micrometres), "%" or another
    # measured beside the user's own settings and those of the presets; each takes time: choose few
    candidates: tuple[Changes, ...]
    # (data, reference) -> error by object, `unit`: compares the output of a candidate with that of the reference; both are
    # data directories, the same one where there is no reference
    errors: Callable[[Path, Path], Mapping[str, float]]
    # the finest settings, which others are compared with; None where the truth is known or nothing is compared
    reference: Changes | None = None
    # data -> number of trials per object of which the error is a share; None if it is no share
    trials: Callable[[Path], int] | None = None
    evaluated_by: str | None = None  # a stage to run on the output before errors can be read

"""What the runner knows of a stage: a protocol, and the task and row that pass between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from rich.console import Console

from pipeline.config.settings import Settings
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.rng import numpy_rng
from pipeline.store.pieces import Row
from schemas.base import Artifact


@dataclass(frozen=True)
class Cost:
    """What an object (or, in a set stage, all of it) takes, typically, on one core: for `--dry-run`."""

    seconds: float
    kilobytes: float


@dataclass(frozen=True)
class Task:
    """One object to process: who it is, the root seed, and what earlier stages know of it.

    `inputs` gives an artifact's arrays for this object, `attributes` what its root says.
    """

    object_id: str
    category: str
    seed: int
    source: Mapping[str, Any] = field(default_factory=dict)
    inputs: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    attributes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    load_mesh: Callable[[], Mesh] | None = None

    def rng(self, *identity: str | int) -> np.random.Generator:
        """A generator for this object and the given names (stage, attempt, …)."""
        return numpy_rng(self.seed, self.object_id, *identity)

    def mesh(self) -> Mesh:
        """The object's normalised mesh in the world frame, as `sample-surfaces` stored it."""
        if self.load_mesh is None:
            raise ValueError(f"{self.object_id}: no stage has stored a mesh yet; a stage that needs one names SURFACES among its inputs")
        return self.load_mesh()


class Stage(Protocol):
    """What all stages have in common."""

    name: ClassVar[str]
    summary: ClassVar[str]
    settings_type: ClassVar[type[Settings]]

    def inputs(self, settings: Any) -> tuple[Artifact, ...]:
        """The artifacts that are read; none that these settings leave out."""

    def models(self, settings: Any) -> tuple[str, ...]:
        """The folders below the data directory that set stages filled and this one reads, such as `models/unet`."""


class ObjectStage(Stage, Protocol):
    """A stage that turns one object's row of its inputs into one row of its output."""

    output: ClassVar[Artifact]

    def assets(self, settings: Any) -> list[Path]:
        """Data files whose content belongs to the key (a hand, a sensor, a scene)."""

    def constants(self, settings: Any) -> Row:
        """The output's arrays that have no object dimension."""

    def attributes(self, settings: Any) -> dict[str, Any]:
        """What the output's root says beyond what every output says (a sensor's description), as JSON."""

    def cost(self, settings: Any) -> Cost:
        """What an object takes, typically."""

    def session(self, settings: Any, models: Mapping[str, Path]) -> AbstractContextManager[Callable[[Task], Row]]:
        """Open what a worker keeps between objects (a renderer, a physics client); yields `process(task) -> row`."""


@dataclass(frozen=True)
class SetJob:
    """What a set stage is told: what to read, and the folder to fill.

    `folder` may hold what a killed run left there: going on with it is the stage's affair. What is random is keyed by
    `seed` and names, as `numpy_rng` takes them.
    """

    data: Path
    folder: Path
    settings: Any
    seed: int
    models: Mapping[str, Path]
    console: Console


class SetStage(Stage, Protocol):
    """A stage that looks at the whole data set at once and fills one folder: a trained model, an evaluation."""

    def splits(self, settings: Any) -> tuple[str, ...]:
        """The splits whose objects are looked at; the others change nothing."""

    def folder(self, settings: Any) -> str:
        """What is filled, below the data directory."""

    def grid(self, settings: Any) -> Mapping[str, Sequence[Any]]:
        """The supplement's grid of hyperparameters, by setting; empty where there is none."""

    def cost(self, settings: Any, objects: int) -> Cost:
        """What it takes altogether, roughly, with so many objects in its splits."""

    def make(self, job: SetJob) -> dict[str, Any]:
        """Fill the job's folder; returns facts for its record (seconds, hardware, the best loss), as JSON."""

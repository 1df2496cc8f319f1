"""What the runner knows of a stage: a protocol, and the task and row that pass between them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.settings import Settings
from schemas.base import Artifact

Row = dict[str, np.ndarray]
"""One object's part of every array of an artifact, without the object dimension."""


class ObjectError(Exception):
    """An object cannot be processed; the message says why, and what a person can do about it."""


class StageError(Exception):
    """A stage cannot work here at all (a library or device is missing); the message says what is, and what to do."""


def rng_of(seed: int, *identity: str | int) -> np.random.Generator:
    """A generator keyed by identity, so that order, shard and worker change nothing.

    The names are hashed with separators, hence ("ab", "c") and ("a", "bc") differ.
    """
    digest = hashlib.sha256("\0".join(map(str, (seed, *identity))).encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))


@dataclass(frozen=True)
class Cost:
    """What an object takes, typically, on one core: for `--dry-run`."""

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
        return rng_of(self.seed, self.object_id, *identity)

    def mesh(self) -> Mesh:
        """The object's normalised mesh in the world frame, as `sample-surfaces` stored it."""
        if self.load_mesh is None:
            raise ValueError(f"{self.object_id}: no stage has stored a mesh yet; a stage that needs one names SURFACES among its inputs")
        return self.load_mesh()


class Stage(Protocol):
    """A stage turns one object's row of its inputs into one row of its output."""

    name: ClassVar[str]
    summary: ClassVar[str]
    output: ClassVar[Artifact]
    inputs: ClassVar[tuple[Artifact, ...]]
    settings_type: ClassVar[type[Settings]]

    def assets(self, settings: Any) -> list[Path]:
        """Data files whose content belongs to the key (a hand, a sensor, a scene)."""

    def constants(self, settings: Any) -> Row:
        """The output's arrays that have no object dimension."""

    def attributes(self, settings: Any) -> dict[str, Any]:
        """What the output's root says beyond what every output says (a sensor's description), as JSON."""

    def cost(self, settings: Any) -> Cost:
        """What an object takes, typically."""

    def session(self, settings: Any) -> AbstractContextManager[Callable[[Task], Row]]:
        """Open what a worker keeps between objects (a renderer, a physics client); yields `process(task) -> row`."""

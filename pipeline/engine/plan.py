"""A plan: what a run of a stage amounts to, worked out before anything is made."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.config.settings import Settings
from pipeline.engine import keys
from pipeline.engine.executor import Executor, Serial
from pipeline.engine.stage import Stage
from pipeline.engine.versions import library_versions, processor
from pipeline.errors import InvalidInput, StageError
from pipeline.store import digest
from pipeline.store.directory import DataDirectory, folder_digest
from pipeline.store.storage import Place

S = TypeVar("S", bound=Stage)


@dataclass(frozen=True)
class Request(Generic[S]):
    """What is asked of a run.

    Attributes
    ----------
    shards
        Into how many shards the objects are split; None takes the dataset's number, or 1.
    executor
        What processes objects.
    strict
        Stop at the first object that fails.
    retry
        Try objects again that failed in this stage.
    check
        Read what was published, and make again what is damaged.
    only
        Process this object alone.
    folder
        The folder to fill, instead of a dataset stage's own.
    """

    stage: S
    settings: Settings
    manifest: str
    objects: Sequence[Object]
    preset: str
    seed: int
    data: Place
    shards: int | None = None
    executor: Executor = field(default_factory=Serial)
    strict: bool = False
    retry: bool = False
    check: bool = False
    only: str | None = None
    folder: str | None = None


@dataclass(frozen=True)
class Forecast:
    """What a run would do: make `missing` of `total` objects, in about that many seconds, and that many kilobytes of output.

    Where it is not `up_to_date` and no object is missing, a run packs those that are made already, or removes a shard without objects.
    """

    missing: int
    total: int
    seconds: float
    kilobytes: float
    up_to_date: bool = False


@dataclass(frozen=True)
class Result:
    """What a run did: the objects it made, those of them that failed, the seconds these took, and those that packing took.

    `waiting` objects are still to be made before the shard is published; 0 where it is.
    """

    made: int = 0
    failed: int = 0
    seconds: float = 0.0
    packing: float = 0.0
    waiting: int = 0


class Plan(ABC, Generic[S]):
    """What a run makes of one output: a shard of an artifact, or a folder. The data directory is read as it is now.

    Raises
    ------
    StoreError
        An input has not been made, or was made from something else than what is there now.
    """

    def __init__(self, request: Request[S]) -> None:
        self.request, self.stage, self.settings = request, request.stage, request.settings
        self.directory = DataDirectory(request.data)
        self.models = {name: self.directory.whole_folder(name) for name in self.stage.models(self.settings)}
        self.inputs = [self.directory.collection(artifact) for artifact in self.stage.inputs(self.settings)]

    @property
    @abstractmethod
    def path(self) -> Place:
        """What is made, as messages name it."""

    @property
    @abstractmethod
    def lock(self) -> Place:
        """The lock that whoever makes it holds."""

    @property
    @abstractmethod
    def key(self) -> str:
        """The hash of everything the output depends on."""

    @property
    def schema(self) -> list[Any]:
        """Name and version of what the output is declared to be."""
        return []

    @property
    @abstractmethod
    def total(self) -> int:
        """How many objects it is made of."""

    def look_again(self) -> None:
        """Forget what was seen of the output; what is asked for next is read again."""

    @abstractmethod
    def up_to_date(self) -> bool:
        """Whether it is there, complete, made under the same key."""

    @abstractmethod
    def forecast(self) -> Forecast:
        """What a run would do."""

    @abstractmethod
    def make(self, console: Console) -> Result:
        """Make what is missing, and publish the output when it is whole; the lock is held."""

    @cached_property
    def stage_key(self) -> str:
        """The hash of what all objects' rows depend on: code, settings, seed, data files and models."""
        with description_errors(self.stage):
            assets = keys.assets_digest(self.stage.assets(self.settings))
        return digest.of_json(
            {
                "stage": self.stage.name,
                "schema": self.schema,
                "code": keys.code_hash(self.stage),
                "settings": self.settings.results(),
                "seed": self.request.seed,
                "assets": assets,
                "models": self.model_digests,
            }
        )

    @cached_property
    def model_digests(self) -> dict[str, str]:
        """The digest of every trained model that is read."""
        return {name: folder_digest(self.directory.folder(name)) for name in self.models}

    def provenance(self) -> dict[str, Any]:
        """The fields that every record has; `location` is filled in on publishing."""
        return {
            "location": "unpublished",
            "stage": self.stage.name,
            "key": self.key,
            "settings": self.settings.results(),
            "speed_settings": self.settings.speed(),
            "preset": self.request.preset,
            "seed": self.request.seed,
            "manifest": self.request.manifest,
            "models": self.model_digests,
            "versions": library_versions(),
            "processor": processor(),
        }


@contextmanager
def description_errors(stage: Stage) -> Iterator[None]:
    """A hand, sensor or scene that cannot be used, or is not that of the inputs, is nobody's failure but ends the run."""
    try:
        yield
    except InvalidInput as error:
        raise StageError(f"{stage.name}: {error}") from error

"""Plans: what a run makes of one output, a shard or a folder, determined before anything is computed."""

import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from rich.console import Console
from rich.markup import escape

from pipeline.config.settings import Settings
from pipeline.config.sources import Object
from pipeline.console import duration, errors
from pipeline.engine import keys
from pipeline.engine.executor import Executor, Serial
from pipeline.engine.stage import Stage, Unit
from pipeline.errors import InvalidInput, StageError, StoreError, first_line
from pipeline.store import digest
from pipeline.store.atomic import exclusive_lock
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Failure, Provenance, library_versions, processor
from pipeline.store.storage import NO_ROOM, Location, is_machine_fault, on_disk

S = TypeVar("S", bound=Stage)


@dataclass(frozen=True)
class Request(Generic[S]):
    """The parameters of a run."""

    stage: S
    settings: Settings
    manifest: str
    objects: Sequence[Object]
    preset: str
    seed: int
    data: Location
    shards: int | None = None  # number of shards that the objects are split into; None takes the dataset's number, or 1
    executor: Executor = field(default_factory=Serial)  # what processes objects
    strict: bool = False  # stop at the first object that fails in this stage
    retry: bool = False  # try objects again that failed in this stage
    check: bool = False  # read the published output, and make damaged rows again
    only: str | None = None  # process this object alone
    reuse: Location | None = None  # another data directory, whose rows with the same keys are copied
    folder: str | None = None  # the folder to fill, instead of a dataset stage's default
    options: Mapping[str, str] = field(default_factory=dict)  # options that named the objects, for the record


@dataclass(frozen=True)
class Made:
    """What a run made of one output, or in a dry run would make."""

    stage: str
    path: Location
    text: str  # what was made, or would be made and what it costs, in words
    objects: int = 0  # that were processed without a failure, or would be processed
    seconds: float = 0.0  # for all of them
    kilobytes: float = 0.0  # that would be written
    notes: tuple[str, ...] = ()  # what the stage reports of the finished output
    failures: Mapping[str, Failure] = field(default_factory=dict)  # of objects in this stage


class Plan(ABC):
    """The plan of one output, from the current state of the data directory: `prepare` it, then `forecast` or `make`."""

    record: Provenance | None  # what is published; None if nothing is, or it cannot be used
    schema: tuple[object, ...] = ()  # name and version of the output's schema, if it has one

    def __init__(
        self,
        request: Request[Any],
        directory: DataDirectory,
        record_path: Location,
        lock: Location,  # which a run holds while it makes the output
        objects: Sequence[Object],  # of the manifest, from which the output may be made
    ) -> None:
        self.request, self.stage, self.settings, self.directory = request, request.stage, request.settings, directory
        self.record_path, self.lock, self.objects = record_path, lock, objects
        self.path: Location = record_path.with_suffix("")  # as messages name the output
        self.units: list[Unit] = []  # the objects' rows that a shard will consist of, or one folder
        self.key, self.total = "", 0  # total: objects that the output is made from; of a folder, without failed ones
        self.refresh()

    @abstractmethod
    def refresh(self) -> None:
        """Read again what is published."""

    def prepare(self) -> Self:
        """Read the inputs; determine units, key and total. A `StoreError` says that an input is missing, or made from other inputs."""
        self.models = {name: self.directory.verified_folder(name) for name in self.stage.models(self.settings)}
        self.model_digests = {name: self.directory.folder(name).digest() for name in self.models}
        self.inputs = [self.directory.collection(artifact) for artifact in self.stage.inputs(self.settings)]
        return self

    @abstractmethod
    def up_to_date(self) -> bool:
        """Check that the output exists, is complete, has the current key, and holds no failure to retry."""

    @abstractmethod
    def current(self) -> Made:
        """Describe an output that is up to date."""

    @abstractmethod
    def estimate(self) -> tuple[int, float, float]:
        """Estimate objects, seconds and kilobytes of a run."""

    @abstractmethod
    def intent(self, objects: int, cost: str) -> str:
        """Say what a run would do that has this number of objects to process."""

    def remarks(self) -> Iterable[str]:
        """Report, before a run, what it would drop or what does not fit."""
        return ()

    @abstractmethod
    def fill(self, console: Console) -> Made:
        """Make what is missing, and publish it."""

    def forecast(self) -> Made:
        """Estimate a run; if an input has not been made yet, by the stage's own estimate."""
        try:
            self.prepare()
        except StoreError:
            requested = [item for item in self.objects if self.request.only in (None, item.object_id)]
            self.total, cost = self.stage.cost_of(self.settings, requested)
            cores = self.request.executor.processes if self.stage.per_object else 1
            objects, seconds, kilobytes = self.total, cost.seconds / cores, cost.kilobytes
        else:
            if self.up_to_date():
                return self.current()
            objects, seconds, kilobytes = self.estimate()
        cost_text = f"about {duration(max(seconds, 1))} and {kilobytes / 1e3:.0f} MB"
        return self.answer(self.intent(objects, cost_text), objects=objects, seconds=seconds, kilobytes=kilobytes)

    def answer(self, text: str, **facts: Any) -> Made:
        """Say what was made, or would be."""
        return Made(self.stage.name, self.path, text, **facts)

    def make(self, console: Console) -> Made:
        """Make what is missing. A run that is killed at any moment continues where it stopped when it is run again."""
        if self.up_to_date():
            return self.current()
        self._warn_of_low_disk_space()
        for line in self.remarks():
            console.print(escape(line))
        try:
            with exclusive_lock(self.lock, self.path):
                self.refresh()  # the previous holder of the lock may have made it
                return self.current() if self.up_to_date() else self.fill(console)
        except StoreError:
            self.refresh()
            if not self.up_to_date():
                raise
            return self.current()  # another run, on another machine, has made the same meanwhile
        except Exception as error:
            locked_out = isinstance(error, PermissionError) and error.filename and Path(error.filename) in (self.lock, *self.lock.parents)
            if not is_machine_fault(error) and not locked_out:
                raise
            if isinstance(error, OSError):
                remedy = "make room there" if error.errno in NO_ROOM else "fix that"
                why = f"{error.strerror}; {f'make {self.directory.root} writable' if locked_out else remedy}"
            else:
                why = f"{first_line(error)}; check that it is reachable"
            raise StoreError(f"{self.path} cannot be written: {why}, then run again: what is finished is kept") from error

    def _warn_of_low_disk_space(self) -> None:
        folder = on_disk(self.request.data)
        if folder is None or not self.total:
            return
        kilobytes = self.stage.cost_of(self.settings, self.objects)[1].kilobytes  # a shard is written as a whole
        free = shutil.disk_usage(next(path for path in (folder, *folder.absolute().parents) if path.exists())).free
        if 1000 * kilobytes > free:
            errors.print(
                f"[yellow]warning:[/] {self.stage.name} writes about {kilobytes / 1e3:.0f} MB, and {free / 1e6:.0f} MB are free for "
                f"{escape(str(folder))}; make room, or name another --data (make: DATA=)"
            )

    @cached_property
    def assets(self) -> str:
        """Compute the digest of the data files that the stage reads, once: later it is compared with theirs."""
        with description_errors(self.stage):
            return keys.assets_digest(self.stage.assets(self.settings))

    @cached_property
    def stage_key(self) -> str:
        """The hash of what all objects' rows depend on: code, settings, seed, data files and models."""
        return digest.of_json(
            {
                "stage": self.stage.name,
                "schema": list(self.schema),
                "code": keys.code_hash(self.stage),
                "settings": self.settings.results(),
                "seed": self.request.seed,
                "assets": self.assets,
                "models": self.model_digests,
            }
        )

    def provenance(self) -> dict[str, Any]:
        """Return the fields that every record has; `location` is filled in on publishing."""
        results = self.settings.results()
        return {
            "location": "unpublished",
            "stage": self.stage.name,
            "key": self.key,
            "settings": results,
            "speed_settings": self.settings.model_dump(mode="json", exclude=set(results)),
            "preset": self.request.preset,
            "seed": self.request.seed,
            "manifest": self.request.manifest,
            "options": dict(self.request.options),
            "models": self.model_digests,
            "versions": library_versions(),
            "processor": processor(),
        }


@contextmanager
def description_errors(stage: Stage) -> Iterator[None]:
    """Raise a `StageError` if a hand, sensor or scene cannot be used, or is not that of the inputs: no object has failed."""
    try:
        yield
    except InvalidInput as error:
        raise StageError(f"{stage.name}: {error}") from error

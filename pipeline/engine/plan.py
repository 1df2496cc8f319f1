"""Plans: the units of one output, a shard or a folder, determined before anything is computed."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar

from pipeline.config.manifest import Object
from pipeline.config.settings import Settings
from pipeline.engine import keys
from pipeline.engine.executor import Executor, Serial
from pipeline.engine.stage import Stage
from pipeline.engine.unit import Unit
from pipeline.engine.versions import library_versions, processor
from pipeline.errors import InvalidInput, StageError
from pipeline.store import digest
from pipeline.store.directory import DataDirectory
from pipeline.store.publish import FolderOutput, ShardOutput
from pipeline.store.record import Failure, ShardRecord
from pipeline.store.storage import Location, exists

S = TypeVar("S", bound=Stage)
Output = TypeVar("Output", bound=ShardOutput | FolderOutput)


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
    folder: str | None = None  # the folder to fill, instead of a dataset stage's default
    options: Mapping[str, str] = field(default_factory=dict)  # options that named the objects, for the record


@dataclass(frozen=True)
class Forecast:
    """An estimate of a run.

    If it is not `up_to_date` and no object is missing, a run publishes finished rows, or removes a shard without
    objects.
    """

    missing: int  # objects to process
    total: int
    seconds: float  # that it takes
    kilobytes: float  # that it writes
    up_to_date: bool = False
    failed: int = 0  # objects that failed in this stage, if the output is up to date
    failed_before: int = 0  # those that failed in earlier stages


@dataclass(frozen=True)
class Summary:
    """A summary of a run."""

    made: int = 0  # objects, without those that failed
    seconds: float = 0.0  # for all objects
    held_back: bool = False  # whether published rows of the shard must be made again before the new ones are published


class Plan(Generic[Output]):
    """The plan of one output, from the current state of the data directory."""

    def __init__(self, request: Request[Any], directory: DataDirectory, output: Output, schema: Sequence[object] = ()) -> None:
        self.request, self.stage, self.settings, self.directory, self.output = request, request.stage, request.settings, directory, output
        self.path: Location = output.path  # as messages name the output
        self.models = {name: self.directory.verified_folder(name) for name in self.stage.models(self.settings)}
        self.model_digests = {name: self.directory.folder(name).digest() for name in self.models}
        self.inputs = [self.directory.collection(artifact) for artifact in self.stage.inputs(self.settings)]
        self.schema = list(schema)
        self.units: list[Unit] = []  # the objects' rows that a shard will consist of, or one folder
        self.key, self.total = "", 0  # total: objects that the output is made from; of a folder, without failed ones
        # objects of the manifest that a shard will lack: `only` asks for another one, and they have not been made yet
        self.missing: tuple[str, ...] = ()

    def up_to_date(self) -> bool:
        """Check that the output exists, is complete, has the current key, and holds no failure to retry."""
        if not self.units:
            return not exists(self.output.record_path)
        record = self.output.record
        if record is None or record.key != self.key:
            return False
        rows = record.rows if isinstance(record, ShardRecord) else ()
        if any(self.failed_here(row.failure) and self.is_retried(row.object_id) for row in rows):
            return False
        return self.output.is_sound() if self.request.check else self.output.is_complete()

    def failed_here(self, failure: Failure | None) -> bool:
        """Check whether a failure arose in this stage."""
        return failure is not None and failure.stage == self.stage.name

    def is_retried(self, object_id: str) -> bool:
        """Check whether an object is processed again if it failed."""
        return self.request.retry and self.request.only in (None, object_id)

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
                "schema": self.schema,
                "code": keys.code_hash(self.stage),
                "settings": self.settings.results(),
                "seed": self.request.seed,
                "assets": self.assets,
                "models": self.model_digests,
            }
        )

    def provenance(self) -> dict[str, Any]:
        """Return the fields that every record has; `location` is filled in on publishing."""
        return {
            "location": "unpublished",
            "stage": self.stage.name,
            "key": self.key,
            "settings": self.settings.results(),
            "speed_settings": self.settings.speed(),
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

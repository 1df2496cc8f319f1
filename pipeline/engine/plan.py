"""Planning: the key of every object of a shard, and with them what there is to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

from pipeline.config.manifest import Object, shard_of
from pipeline.config.settings import Settings
from pipeline.config.sources import fingerprint
from pipeline.engine import keys
from pipeline.engine.stage import Cost, ObjectStage, Stage
from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.collection import Collection, with_origins
from pipeline.store.layout import Layout
from pipeline.store.pieces import Piece, Pieces
from pipeline.store.record import Record, check_models, standing_record
from pipeline.store.shard import Shard

S = TypeVar("S", bound=Stage)


@dataclass(frozen=True)
class Request(Generic[S]):
    """What is asked of a run."""

    stage: S
    settings: Settings
    manifest: str
    objects: Sequence[Object]
    preset: str
    seed: int
    data: Path
    shards: int = 1
    workers: int = 1
    strict: bool = False
    retry: bool = False
    only: str | None = None


@dataclass(frozen=True)
class Job:
    """An object to process, the key its row is made under, and the digests of the rows it is made from, by artifact."""

    item: Object
    key: str
    inputs: dict[str, str] = field(default_factory=dict)


@dataclass
class Plan:
    """What a run of one shard amounts to."""

    request: Request[ObjectStage]
    number: int
    jobs: list[Job] = field(default_factory=list)
    failed_before: dict[str, Piece] = field(default_factory=dict)
    """Objects that cannot be processed because an earlier stage, or reading their source, failed."""
    records: dict[str, Record] = field(default_factory=dict)
    """The models that are read, by name."""
    key: str = ""

    @property
    def layout(self) -> Layout:
        """The data directory."""
        return Layout(self.request.data)

    @property
    def path(self) -> Path:
        """Where the shard will stand."""
        return self.layout.shard(self.request.stage.output.name, self.number)

    @cached_property
    def pieces(self) -> Pieces:
        """What an earlier run has left half done."""
        return Pieces(self.layout.work(self.request.stage.output.name))

    def up_to_date(self) -> bool:
        """Whether the shard stands there, made under the same key, with no failure that is to be tried again."""
        try:
            attributes = Shard(self.path, self.request.stage.output).attributes
        except StoreError:
            return False
        own_failures = (failure for failure in attributes["failures"].values() if failure["stage"] == self.request.stage.name)
        return attributes.get("key") == self.key and not (self.request.retry and any(own_failures))

    def piece(self, job: Job) -> Piece | None:
        """What became of a job's object, None where that is not known yet."""
        return self.failed_before.get(job.item.object_id) or self.pieces.load(job.item.object_id, job.key)

    def unfinished(self) -> list[Job]:
        """The jobs whose piece is not there, whether asked for or not."""
        return [
            job for job in self.jobs if job.item.object_id not in self.failed_before and not self.pieces.has(job.item.object_id, job.key)
        ]

    def missing(self) -> list[Job]:
        """The jobs that are asked for and whose piece is not there yet."""
        return [job for job in self.unfinished() if self.request.only in (None, job.item.object_id)]

    def cost(self) -> Cost:
        """What an object takes: as it was in this data directory, else as the stage says."""
        seconds = [value for _, path in self.layout.shards(self.path.parent.name) for value in _seconds(path, self)]
        typical = self.request.stage.cost(self.request.settings)
        return Cost(sum(seconds) / len(seconds) if seconds else typical.seconds, typical.kilobytes)


def _seconds(path: Path, plan: Plan) -> list[float]:
    try:
        shard = Shard(path, plan.request.stage.output)
    except StoreError:
        return []
    same = shard.attributes["settings"] == plan.request.settings.results()
    return [float(value) for value in shard.attributes["seconds"]] if same else []


def make_plan(request: Request[ObjectStage], number: int) -> Plan:
    """Work out the keys of a shard's objects, and with them its own.

    Raises
    ------
    StoreError
        An input has not been made for one of the objects, or was itself made from another input than stands there now.
    """
    plan = Plan(request, number)
    plan.records = {name: standing_record(plan.layout, name) for name in request.stage.models(request.settings)}
    stage_part = _stage_part(request, plan.records)
    inputs = [Collection(plan.layout, artifact, request.shards) for artifact in request.stage.inputs(request.settings)]
    for collection in inputs:
        check_models(plan.layout, collection)
    origins = with_origins(inputs, request.shards)
    for item in shard_of(request.objects, number, request.shards):
        _check_origins(origins, item.object_id)
        job, failure = _job(request, stage_part, inputs, item) if inputs else _first_job(request, stage_part, item)
        plan.jobs.append(job)
        if failure:
            plan.failed_before[item.object_id] = Piece({}, 0.0, failure)
    rows = [(job.key, job.item.split) for job in plan.jobs]  # another split of the same rows is packed anew, and nothing computed
    whole = {"stage": stage_part, "rows": rows, "shard": [number, request.shards]}
    plan.key = digest.of_json({**whole, "manifest": request.manifest})
    return plan


def _stage_part(request: Request[ObjectStage], records: Mapping[str, Record]) -> str:
    """What the keys of all objects have in common."""
    stage, settings = request.stage, request.settings
    try:
        assets = keys.asset_hashes(stage.assets(settings))
    except ValueError as error:  # a hand, sensor or scene that is not there, or not valid
        raise StoreError(f"{stage.name}: {error}") from error
    return digest.of_json(
        {
            "stage": stage.name,
            "schema": [stage.output.name, stage.output.version],
            "code": keys.code_hash(stage),
            "settings": settings.results(),
            "assets": assets,
            "seed": request.seed,
            **({"models": {name: record.digest for name, record in records.items()}} if records else {}),
        }
    )


def _first_job(request: Request[ObjectStage], stage_part: str, item: Object) -> tuple[Job, dict[str, str] | None]:
    """The job of a stage that reads the manifest's sources."""
    failure = None
    try:
        origin: dict[str, Any] = {"source": fingerprint(item.source)}
    except OSError as error:
        origin = {"unreadable": str(error)}
        failure = {"stage": request.stage.name, "reason": f"its file cannot be read: {error}; mend or remove it"}
    return Job(item, keys.object_key(stage_part, item.object_id, item.category, origin)), failure


def _job(request: Request[ObjectStage], stage_part: str, inputs: Sequence[Collection], item: Object) -> tuple[Job, dict[str, str] | None]:
    """The job of a stage that reads earlier ones."""
    standing = {collection.artifact.name: collection.shard(item.object_id) for collection in inputs}
    rows = {name: shard.row_digest(item.object_id) for name, shard in standing.items()}
    failure = next((found for shard in standing.values() if (found := shard.failure(item.object_id))), None)
    return Job(item, keys.object_key(stage_part, item.object_id, item.category, rows), rows), failure


def _check_origins(collections: Sequence[Collection], object_id: str) -> None:
    """A `StoreError` where an object's row was made from another row than stands in another of the collections."""
    standing = {collection.artifact.name: collection.shard(object_id) for collection in collections if object_id in collection}
    for name, shard in standing.items():
        for origin, used in shard.input_digests(object_id).items():
            if origin in standing and standing[origin].row_digest(object_id) != used:
                raise StoreError(
                    f"{shard.path}: {name} of {object_id} was made from other {origin} than stand there now; run its stage again"
                )

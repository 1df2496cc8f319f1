"""Running a stage on a shard: what is there is left alone, what is missing is made, object by object."""

from __future__ import annotations

import fcntl
import importlib.metadata
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from pipeline import keys
from pipeline.manifest import Object, shard_of
from pipeline.settings import Settings
from pipeline.sources import fingerprint
from pipeline.stage import Cost, ObjectError, Stage
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from pipeline.store.pieces import Piece, Pieces
from pipeline.store.shard import Shard, StoreError, row_digest
from pipeline.store.write import Header, conform, write_shard
from pipeline.workers import Job, Outcome, Work, run_jobs
from schemas.base import COMMON

LIBRARIES = ("vt-pipeline", "numpy", "scipy", "trimesh", "pybullet", "embreex", "libigl", "pyrender-maintained", "zarr")


@dataclass(frozen=True)
class Request:
    """What is asked of a run."""

    stage: Stage
    settings: Settings
    manifest: str
    objects: Sequence[Object]
    preset: str
    seed: int
    data: Path
    shards: int = 1
    workers: int = 1
    strict: bool = False
    only: str | None = None


@dataclass
class Plan:
    """What a run of one shard amounts to: every object's key, and which rows are missing."""

    request: Request
    number: int
    jobs: list[Job] = field(default_factory=list)
    failed_before: dict[str, Piece] = field(default_factory=dict)
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
        """Whether the shard stands there, made under the same key."""
        try:
            return Shard(self.path, self.request.stage.output).attributes.get("key") == self.key
        except StoreError:
            return False

    def missing(self) -> list[Job]:
        """The jobs whose piece is not there yet."""
        asked = (job for job in self.jobs if self.request.only in (None, job.item.object_id))
        return [job for job in asked if job.item.object_id not in self.failed_before and not self.pieces.has(job.item.object_id, job.key)]

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


def make_plan(request: Request, number: int) -> Plan:
    """Work out the keys of a shard's objects, and with them its own.

    Raises
    ------
    StoreError
        An input has not been made for one of the objects.
    """
    stage, settings = request.stage, request.settings
    plan = Plan(request, number)
    stage_part = digest.of_json(
        {
            "stage": stage.name,
            "schema": [stage.output.name, stage.output.version],
            "code": keys.code_hash(stage),
            "settings": settings.results(),
            "assets": keys.asset_hashes(stage.assets(settings)),
            "seed": request.seed,
        }
    )
    inputs = [Collection(plan.layout, artifact) for artifact in stage.inputs]
    for item in shard_of(request.objects, number, request.shards):
        rows = {collection.artifact.name: collection.shard(item.object_id).row_digest(item.object_id) for collection in inputs}
        failure = next((f for c in inputs if (f := c.shard(item.object_id).failure(item.object_id))), None)
        origin = rows if inputs else {"source": fingerprint(item.source), "split": item.split}
        plan.jobs.append(Job(item, keys.object_key(stage_part, item.object_id, item.category, origin)))
        if failure:
            plan.failed_before[item.object_id] = Piece({}, 0.0, failure)
    whole = {"stage": stage_part, "rows": [job.key for job in plan.jobs], "shard": [number, request.shards]}
    plan.key = digest.of_json({**whole, "manifest": request.manifest})
    return plan


def execute(plan: Plan) -> Iterator[Outcome]:
    """Make a shard: process what is missing, then pack, validate and put it in place; yields as objects finish.

    Killed at any moment and run again, it goes on where it was. With `only`, that object's piece is made and nothing
    packed unless it was the last one missing.
    """
    request = plan.request
    with _one_at_a_time(plan):
        if plan.up_to_date():  # by the run that held the lock before
            return
        _take_over(plan)
        work = Work(request.stage, request.settings, request.seed, request.data)
        if missing := plan.missing():
            for outcome in run_jobs(work, missing, request.workers):
                yield outcome
                if request.strict and outcome.reason:
                    raise ObjectError(f"{outcome.object_id}: {outcome.reason} (--strict stops here; without it the others go on)")
        if all(job.item.object_id in plan.failed_before or plan.pieces.has(job.item.object_id, job.key) for job in plan.jobs):
            _commit(plan)


def _load(plan: Plan, job: Job) -> Piece:
    piece = plan.failed_before.get(job.item.object_id) or plan.pieces.load(job.item.object_id, job.key)
    if piece is None:
        raise StoreError(f"{plan.pieces.path(job.item.object_id, job.key)} cannot be read; delete it and run again")
    return piece


def _commit(plan: Plan) -> None:
    request, jobs = plan.request, {job.item.object_id: job for job in plan.jobs}
    artifact = request.stage.output
    constants = conform(artifact, request.stage.constants(request.settings), constants=True)
    digests, failures, seconds = [], {}, []
    for object_id, job in jobs.items():
        piece = _load(plan, job)
        digests.append(row_digest(piece.row, piece.failure))
        seconds.append(round(piece.seconds, 4))
        if piece.failure:
            failures[object_id] = piece.failure
    header = Header(
        object_ids=list(jobs),
        categories=[job.item.category for job in jobs.values()],
        attributes={
            "schema": artifact.name,
            "schema_version": artifact.version,
            "stage": request.stage.name,
            "key": plan.key,
            "object_keys": [job.key for job in jobs.values()],
            "digests": digests,
            "constants_digest": digest.of_arrays(constants),
            "settings": request.settings.results(),
            "speed_settings": request.settings.speed(),
            "preset": request.preset,
            "seed": request.seed,
            "manifest": request.manifest,
            "shard": plan.number,
            "shards": request.shards,
            "failures": failures,
            "seconds": seconds,
            "versions": {name: importlib.metadata.version(name) for name in LIBRARIES},
            **request.stage.attributes(request.settings),
        },
    )
    beside = plan.layout.work(artifact.name) / f"{plan.path.name}.{os.getpid()}.beside"
    write_shard(plan.path, artifact, header, lambda object_id: _load(plan, jobs[object_id]), constants, beside)
    plan.pieces.discard(jobs)
    _drop_other_layouts(plan)


def _take_over(plan: Plan) -> None:
    """Make pieces of rows that stand in some shard under the same key: of another split, or of a smaller manifest.

    So that objects are not lost to shards that are still to come, those that this shard's predecessor held are kept too.
    """
    artifact = plan.request.stage.output
    keys_wanted = {job.item.object_id: job.key for job in plan.missing()}
    elsewhere = {item.object_id for item in plan.request.objects} - {job.item.object_id for job in plan.jobs}
    for _, path in plan.layout.shards(artifact.name):
        try:
            shard = Shard(path, artifact)
            for object_id in shard.object_ids:
                key = shard.object_key(object_id)
                wanted = keys_wanted.get(object_id) == key or (path == plan.path and object_id in elsewhere)
                if wanted and shard.failure(object_id) is None:
                    _take_row(plan.pieces, shard, object_id, key)
        except Exception:  # damaged, or being replaced by a run beside this one: then the rows are made anew
            continue


def _take_row(pieces: Pieces, shard: Shard, object_id: str, key: str) -> None:
    row = {name: value for name, value in shard.view(object_id).items() if name not in COMMON}
    if row_digest(row, None) == shard.row_digest(object_id):
        pieces.save(object_id, key, Piece(row, float(shard.attributes["seconds"][shard.rows[object_id]])))


def _drop_other_layouts(plan: Plan) -> None:
    """Once every shard of this split is there, shards of an earlier, finer split hold the same objects twice."""
    artifact = plan.request.stage.output.name
    standing = dict(plan.layout.shards(artifact))
    if all(number in standing for number in range(plan.request.shards)):
        for number, path in standing.items():
            if number >= plan.request.shards:
                shutil.rmtree(path)


@contextmanager
def _one_at_a_time(plan: Plan) -> Iterator[None]:
    """Hold the shard's lock: the system frees it however its holder ends."""
    lock = plan.layout.work(plan.path.parent.name) / f"{plan.number:04d}.lock"
    lock.parent.mkdir(parents=True, exist_ok=True)
    with lock.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StoreError(f"{plan.path} is being made by another run; wait for it to end") from None
        yield

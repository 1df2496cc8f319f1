"""Running a stage on a shard: what is there is left alone, what is missing is made, object by object."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.engine.plan import Job, Plan
from pipeline.engine.takeover import drop_other_splits, take_over
from pipeline.engine.versions import library_versions
from pipeline.engine.workers import Outcome, Work, run_jobs
from pipeline.errors import InvalidInput, StoreError
from pipeline.store import digest
from pipeline.store.atomic import one_writer
from pipeline.store.collection import Collection
from pipeline.store.pieces import Piece
from pipeline.store.shard import row_digest
from pipeline.store.write import Header, conform, write_shard


def execute(plan: Plan) -> Iterator[Outcome]:
    """Make a shard: process what is missing, then pack, validate and put it in place; yields as objects finish.

    Killed at any moment and run again, it goes on where it was. With `only`, that object's piece is made and nothing
    packed unless it was the last one missing.

    Raises
    ------
    InvalidInput
        With `strict`, at the first object that fails, or that failed before.
    StageError
        The stage cannot start here.
    StoreError
        Another run holds the shard, other objects stand in its place, an input is damaged, or what was made cannot be stored.
    """
    request = plan.request
    with one_writer(plan.layout.work(plan.path.parent.name) / f"{plan.number:04d}.lock", plan.path):
        if plan.up_to_date():  # by the run that held the lock before
            return
        _refuse_strangers(plan)
        if request.retry:
            _forget_failures(plan)
        take_over(plan)
        if request.strict:
            _refuse_failures(plan)
        if missing := plan.missing():
            models = {name: record.folder for name, record in plan.records.items()}
            work = Work(request.stage, request.settings, request.seed, request.shards, request.data, models)
            for outcome in run_jobs(work, missing, request.workers):
                yield outcome
                if request.strict and outcome.reason:
                    raise InvalidInput(_strictly(outcome.object_id, outcome.reason))
        left = plan.unfinished()
        if not left:
            _commit(plan)
        elif request.only is None:
            raise StoreError(
                f"{len(left)} pieces of {plan.path} are gone, {left[0].item.object_id} first: did another run pack them? Run again"
            )


def _refuse_strangers(plan: Plan) -> None:
    """A data directory of other objects would be lost: two folders of meshes go by one name, or a manifest by another's."""
    request = plan.request
    standing = Collection(plan.layout, request.stage.output, request.shards)
    if len(standing) and not any(item.object_id in standing for item in request.objects):
        few = ", ".join(sorted(standing)[:3])
        raise StoreError(
            f"{plan.path.parent} holds other objects ({few}{', …' if len(standing) > 3 else ''}), and none of manifest {request.manifest}; "
            "name another --data (make: DATA=), or delete it"
        )


def _strictly(object_id: str, reason: str) -> str:
    return f"{object_id}: {reason} (--strict stops here; without it the others go on)"


def _refuse_failures(plan: Plan) -> None:
    for job in plan.jobs:
        piece = plan.piece(job)
        if piece and piece.failure:
            raise InvalidInput(_strictly(job.item.object_id, piece.failure["reason"]))


def _forget_failures(plan: Plan) -> None:
    for job in plan.jobs:
        if plan.request.only in (None, job.item.object_id):
            piece = plan.pieces.load(job.item.object_id, job.key)
            if piece and piece.failure:
                plan.pieces.discard([job.item.object_id])


def _load(plan: Plan, job: Job) -> Piece:
    piece = plan.piece(job)
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
        digests.append(row_digest(piece.row, piece.failure, job.item.category))
        seconds.append(round(piece.seconds, 4))
        if piece.failure:
            failures[object_id] = piece.failure
    header = Header(
        object_ids=list(jobs),
        categories=[job.item.category for job in jobs.values()],
        splits=[job.item.split for job in jobs.values()],
        attributes={
            "schema": artifact.name,
            "schema_version": artifact.version,
            "stage": request.stage.name,
            "key": plan.key,
            "object_keys": [job.key for job in jobs.values()],
            "input_digests": [job.inputs for job in jobs.values()],
            "models": {name: record.digest for name, record in plan.records.items()},
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
            "versions": library_versions(),
            **request.stage.attributes(request.settings),
        },
    )
    beside = plan.layout.work(artifact.name) / f"{plan.path.name}.beside"  # the lock is held: nobody else writes there
    write_shard(plan.path, artifact, header, lambda object_id: _load(plan, jobs[object_id]), constants, beside)
    plan.pieces.discard(jobs)
    drop_other_splits(plan)

"""When a data set is split anew or its manifest changes, rows that were made under the same key are taken over."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

from pipeline.engine.plan import Plan
from pipeline.errors import StoreError
from pipeline.store.atomic import one_writer
from pipeline.store.pieces import Piece
from pipeline.store.shard import Shard, row_digest
from schemas.base import Artifact

_GONE = (StoreError, KeyError, ValueError, FileNotFoundError)
"""What reading a shard raises that is damaged, or that a run beside this one is replacing: its rows are made anew."""


def takeable(plan: Plan) -> Iterator[tuple[Shard, str, str]]:
    """Shard, object and key of every finished row that this plan lacks, whether it is asked for or only packed with what is.

    So that objects are not lost to shards that are still to come, those that this shard's predecessor held are among them. Failures
    are tried again, unless this run is asked for another object.
    """
    wanted = {job.item.object_id: job.key for job in plan.unfinished()}
    mine = {job.item.object_id for job in plan.jobs}
    elsewhere = {item.object_id for item in plan.request.objects} - mine
    shards = []
    for _, path in plan.layout.shards(plan.request.stage.output.name):
        try:
            shards.append((path, shard := Shard(path, plan.request.stage.output)))
            if shard.attributes["shards"] == plan.request.shards and path != plan.path:
                elsewhere -= set(shard.object_ids)  # it is settled there
        except _GONE:
            continue
    for path, shard in shards:
        for object_id in shard.object_ids:
            key = shard.object_key(object_id)
            lost = path == plan.path and object_id in elsewhere and shard.attributes["shards"] != plan.request.shards
            settled = shard.failure(object_id) is None or plan.request.only not in (None, object_id)
            if (wanted.get(object_id) == key or lost) and settled:
                yield shard, object_id, key


def take_over(plan: Plan) -> None:
    """Make pieces of the rows that can be taken over, each only if it is still what was written."""
    for shard, object_id, key in list(takeable(plan)):
        try:
            view, failure = shard.view(object_id), shard.failure(object_id)
            row = {} if failure else view.row()
            if row_digest(row, failure, str(view["category"])) == shard.row_digest(object_id):
                plan.pieces.save(object_id, key, Piece(row, float(shard.attributes["seconds"][shard.rows[object_id]]), failure))
        except _GONE:
            continue


def drop_other_splits(plan: Plan) -> None:
    """Once every shard of this split stands, what is left of a finer one holds the same objects twice."""
    artifact, count = plan.request.stage.output, plan.request.shards
    with one_writer(plan.layout.work(artifact.name) / "drop.lock", plan.path.parent, wait=True):
        standing = dict(plan.layout.shards(artifact.name))
        if not all(number in standing and _is_of_split(standing[number], artifact, count) for number in range(count)):
            return
        for number, path in standing.items():
            if number >= count:
                doomed = plan.layout.work(artifact.name) / f"{path.name}.dropped"
                shutil.rmtree(doomed, ignore_errors=True)
                path.replace(doomed)  # at once, so that nobody reads half of it
                shutil.rmtree(doomed)


def _is_of_split(path: Path, artifact: Artifact, count: int) -> bool:
    """Whether a shard is one of so many; one that is just being put in place is not yet, and whoever does that looks again."""
    try:
        return bool(Shard(path, artifact).attributes["shards"] == count)
    except _GONE:
        return False

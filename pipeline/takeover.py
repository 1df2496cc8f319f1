"""When a data set is split anew or its manifest changes, rows that were made under the same key are taken over."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

from pipeline.plan import Plan
from pipeline.store.pieces import Piece
from pipeline.store.shard import Shard, StoreError, row_digest

_GONE = (StoreError, KeyError, ValueError, FileNotFoundError)
"""What reading a shard raises that is damaged, or that a run beside this one is replacing: its rows are made anew."""


def takeable(plan: Plan) -> Iterator[tuple[Shard, str, str]]:
    """Shard, object and key of every finished row that this plan lacks.

    So that objects are not lost to shards that are still to come, those that this shard's predecessor held are among them.
    """
    wanted = {job.item.object_id: job.key for job in plan.missing()}
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
            if (wanted.get(object_id) == key or lost) and shard.failure(object_id) is None:
                yield shard, object_id, key


def take_over(plan: Plan) -> None:
    """Make pieces of the rows that can be taken over, each only if it is still what was written."""
    for shard, object_id, key in list(takeable(plan)):
        try:
            view = shard.view(object_id)
            row = view.row()
            if row_digest(row, None, str(view["category"])) == shard.row_digest(object_id):
                plan.pieces.save(object_id, key, Piece(row, float(shard.attributes["seconds"][shard.rows[object_id]])))
        except _GONE:
            continue


def drop_other_splits(plan: Plan) -> None:
    """Once every shard of this split stands, what is left of a finer one holds the same objects twice."""
    artifact = plan.request.stage.output
    standing = dict(plan.layout.shards(artifact.name))
    count = plan.request.shards
    if all(number in standing and Shard(standing[number], artifact).attributes["shards"] == count for number in range(count)):
        for number, path in standing.items():
            if number >= count:
                doomed = plan.layout.work(artifact.name) / f"{path.name}.dropped"
                shutil.rmtree(doomed, ignore_errors=True)
                path.replace(doomed)  # at once, so that nobody reads half of it
                shutil.rmtree(doomed)

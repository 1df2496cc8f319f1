"""Run a stage: what is up to date is left alone, what is missing is made."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

from rich.console import Console

from pipeline.engine.folder_plan import FolderPlan
from pipeline.engine.plan import Plan, Request, Result
from pipeline.engine.shard_plan import ShardPlan
from pipeline.engine.stage import DatasetStage, ObjectStage
from pipeline.store.atomic import one_writer
from pipeline.store.directory import DataDirectory


def make_plans(request: Request[Any], shard: int | None = None) -> Iterator[Plan[Any]]:
    """Plan a stage: one plan per shard, or the one of `shard`, each made when it is asked for; a dataset stage has one plan.

    Raises
    ------
    StoreError
        The dataset is split into another number of shards, or an input is missing or was made from something else.
    """
    if isinstance(request.stage, DatasetStage):
        yield FolderPlan(request)
        return
    of_objects = cast(Request[ObjectStage], request)
    shards = DataDirectory(request.data).claim_shards(request.shards)
    for number in range(shards) if shard is None else [shard]:
        yield ShardPlan(of_objects, number, shards)


def run(plan: Plan[Any], console: Console) -> Result:
    """Make what a plan lacks; killed at any moment and run again, it continues where it stopped.

    Raises
    ------
    InvalidInput
        With `strict`, at the first object that fails, or that failed before.
    StageError
        The stage cannot work here.
    StoreError
        Another run is at it, other objects are in its place, an input is damaged, or what was made cannot be stored.
    BugFound
        Processing an object raised what no stage is meant to raise.
    """
    with one_writer(plan.lock, plan.path):
        return Result(0, 0, 0.0) if plan.up_to_date() else plan.make(console)  # the run that held the lock before may have made it

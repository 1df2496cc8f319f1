"""Run a stage: what is up to date is left alone, what is missing is made."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

from rich.console import Console

from pipeline.engine.folder_plan import FolderPlan
from pipeline.engine.plan import Forecast, Request, Result
from pipeline.engine.shard_plan import ShardPlan
from pipeline.engine.stage import Cost, DatasetStage, ObjectStage
from pipeline.errors import StoreError
from pipeline.store.atomic import is_machine_fault, one_writer
from pipeline.store.directory import DataDirectory


def make_plans(request: Request[Any], shard: int | None = None) -> Iterator[ShardPlan | FolderPlan]:
    """Plan a stage: one plan per shard, or the one of `shard`, each made when it is asked for; a dataset stage has one plan.

    Raises
    ------
    StoreError
        The dataset is split into another number of shards, or an input is missing or was made from something else.
    """
    if isinstance(request.stage, DatasetStage):
        yield FolderPlan(request)
        return
    shards = DataDirectory(request.data).settled_shards(request.shards)
    if shard is not None and shard >= shards:
        raise StoreError(f"there is no shard {shard} of {shards}: shards are numbered 0 to {shards - 1}")
    for number in range(shards) if shard is None else [shard]:
        yield ShardPlan(cast(Request[ObjectStage], request), number, shards)


def forecast(request: Request[Any], shard: int | None = None) -> Iterator[tuple[Path, Forecast]]:
    """Say of each output what a run would do; where an input has not been made yet, what the stage says of itself."""
    try:
        yield from ((plan.path, plan.forecast()) for plan in make_plans(request, shard))
    except StoreError:
        stage, settings, total = request.stage, request.settings, len(request.objects)
        if isinstance(stage, DatasetStage):
            total = sum(item.split in stage.splits(settings) for item in request.objects)
            cost, seconds, path = stage.cost(settings, total), stage.cost(settings, total).seconds, stage.folder(settings)
        else:
            cost = stage.cost(settings)
            cost, path = Cost(cost.seconds, cost.kilobytes * total), stage.output.name
            seconds = cost.seconds * total / max(1, request.workers)
        yield request.data / path, Forecast(total, total, seconds, cost.kilobytes)


def run(plan: ShardPlan | FolderPlan, console: Console) -> Result:
    """Make what a plan lacks; killed at any moment and run again, it continues where it stopped.

    Raises
    ------
    InvalidInput
        With `strict`, at the first object that fails, or that failed before.
    StageError
        The stage cannot work here, or a hand, sensor or scene file cannot be used.
    StoreError
        Another run is at it, other objects are in its place, an input is damaged, or what was made cannot be stored (a full disk).
    BugFound
        Processing an object raised what no stage is meant to raise.
    """
    with one_writer(plan.lock, plan.path):
        plan.look_again()  # the run that held the lock before may have made it
        try:
            return Result() if plan.up_to_date() else plan.make(console)
        except OSError as error:
            if not is_machine_fault(error):
                raise
            raise StoreError(
                f"{plan.path} cannot be written: {error.strerror}; make room there, then run again: what is finished is kept"
            ) from error

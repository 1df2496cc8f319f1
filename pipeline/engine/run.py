"""Run a stage: reuse what is up to date, make what is missing."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.engine.folder import forecast_folder, make_folder, plan_folder
from pipeline.engine.plan import Forecast, Plan, Request, Summary
from pipeline.engine.shard import forecast_shard, make_shard, plan_shard
from pipeline.engine.stage import DatasetStage
from pipeline.errors import StoreError, first_line
from pipeline.store.atomic import exclusive_lock
from pipeline.store.directory import DataDirectory, shard_of
from pipeline.store.publish import FolderOutput
from pipeline.store.storage import NO_ROOM, Location, is_machine_fault


def make_plans(request: Request[Any], shard: int | None = None) -> Iterator[Plan[Any]]:
    """Plan a stage: one plan per shard, or only `shard`'s or the requested object's; a dataset stage has one plan.

    A `StoreError` says that the dataset is split into another number of shards, that an input is missing or was made
    from other inputs, or that the requested object is in another shard than `shard`.
    """
    if isinstance(request.stage, DatasetStage):
        yield plan_folder(request)
        return
    directory = DataDirectory(request.data)  # once for all: what others publish in its inputs meanwhile needs another run
    shards, numbers = _selected_shards(request, directory, shard)
    for number in numbers:
        yield plan_shard(request, directory, number, shards)


def _selected_shards(request: Request[Any], directory: DataDirectory, shard: int | None) -> tuple[int, Sequence[int]]:
    """Return the dataset's number of shards, and the numbers of the requested ones."""
    shards = directory.check_shard_count(request.shards)
    if shard is not None and shard >= shards:
        raise StoreError(f"there is no shard {shard} of {shards}: shards are numbered 0 to {shards - 1}")
    object_shard = None if request.only is None else shard_of(request.only, shards)
    if None not in (shard, object_shard) and shard != object_shard:
        raise StoreError(
            f"object {request.only} is in shard {object_shard} of {shards}, shard {shard} was asked for; leave one of them out"
        )
    selected = object_shard if shard is None else shard
    return shards, range(shards) if selected is None else [selected]


def forecast(request: Request[Any], shard: int | None = None) -> Iterator[tuple[Location, Forecast]]:
    """Estimate a run, output by output; if an input has not been made yet, by the stage's own estimate."""
    if isinstance(request.stage, DatasetStage):
        yield _forecast_output(request, request.objects, lambda: plan_folder(request))
        return
    directory = DataDirectory(request.data)
    shards, numbers = _selected_shards(request, directory, shard)
    for number in numbers:
        items = [item for item in request.objects if shard_of(item.object_id, shards) == number and request.only in (None, item.object_id)]
        yield _forecast_output(request, items, partial(plan_shard, request, directory, number, shards))


def _forecast_output(request: Request[Any], objects: Sequence[Object], make_plan: Callable[[], Plan[Any]]) -> tuple[Location, Forecast]:
    try:
        plan = make_plan()
        return plan.path, forecast_folder(plan) if isinstance(plan.output, FolderOutput) else forecast_shard(plan)
    except StoreError:
        total, cost = request.stage.cost_of(request.settings, objects)
        cores = 1 if isinstance(request.stage, DatasetStage) else request.executor.processes
        return request.data / request.stage.writes(request.settings), Forecast(total, total, cost.seconds / cores, cost.kilobytes)


def run(plan: Plan[Any], console: Console) -> Summary:
    """Make what a plan lacks. A run that is killed at any moment continues where it stopped when it is run again.

    An `InvalidInput` ends it at the first object that fails in this stage, or failed in it before, if `strict`; a
    `StageError`, if the stage cannot work here, or a hand, sensor or scene file cannot be used; a `StoreError`, if
    another run is making the output, it holds other objects, an input is damaged, or results cannot be stored (a full
    disk, a directory that may not be written to); a `BugFound`, if processing an object raised an unexpected exception.
    """
    try:
        with exclusive_lock(plan.output.lock, plan.path):
            plan.output.refresh()  # the previous holder of the lock may have made it
            if plan.up_to_date():
                return Summary()
            return make_folder(plan, console) if isinstance(plan.output, FolderOutput) else make_shard(plan, console)
    except StoreError:
        plan.output.refresh()
        if not plan.up_to_date():
            raise
        return Summary()  # another run, on another machine, has made the same meanwhile
    except Exception as error:
        lock = plan.output.lock
        locked_out = isinstance(error, PermissionError) and error.filename and Path(error.filename) in (lock, *lock.parents)
        if not is_machine_fault(error) and not locked_out:
            raise
        if isinstance(error, OSError):
            remedy = f"make {plan.directory.root} writable" if locked_out else "make room there" if error.errno in NO_ROOM else "fix that"
            why = f"{error.strerror}; {remedy}"
        else:
            why = f"{first_line(error)}; see that it is reachable"
        raise StoreError(f"{plan.path} cannot be written: {why}, then run again: what is finished is kept") from error

"""Make the output of a stage: reuse what is up to date, make what is missing."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rich.console import Console

from pipeline.engine.folder_plan import FolderPlan
from pipeline.engine.plan import Made, Plan, Request
from pipeline.engine.shard_plan import ShardPlan
from pipeline.errors import InvalidInput, StoreError
from pipeline.store.directory import DataDirectory, shard_of


def make(
    request: Request[Any],
    console: Console,
    shard: int | None = None,  # only this shard
    *,
    dry_run: bool = False,  # answer what would be made, and what it costs
    report: Callable[[Made], None] | None = None,  # called after each output
) -> list[Made]:
    """Make all outputs of a stage, or only a shard or the requested object; errors are those of `Plan.make`."""
    answers = []
    for plan in _outputs(request, shard):
        answer = plan.forecast() if dry_run else plan.prepare().make(console)
        if report:
            report(answer)
        if request.strict and answer.failures and not dry_run:
            raise InvalidInput(f"{len(answer.failures)} failed in {answer.path}, and --strict was asked for")
        answers.append(answer)
    return answers


def plans(request: Request[Any], shard: int | None = None) -> Iterator[Plan]:
    """Plan a stage, output by output."""
    return (plan.prepare() for plan in _outputs(request, shard))


def _outputs(request: Request[Any], shard: int | None) -> Iterator[Plan]:
    """Plan a stage's outputs: its shards, or only `shard` or that of the requested object; or the folder of a dataset stage."""
    numbers = shard_numbers(request, shard)
    if not request.stage.per_object:
        yield FolderPlan(request)
        return
    directory = DataDirectory(request.data)  # once for all: what others publish in its inputs meanwhile needs another run
    for number in numbers:
        yield ShardPlan(request, directory, number, directory.check_shard_count(request.shards))


def shard_numbers(request: Request[Any], shard: int | None) -> Sequence[int]:
    """Choose the shards that a run makes, none of a dataset stage."""
    if not request.stage.per_object:
        if request.only is not None or shard is not None:
            raise InvalidInput(f"{request.stage.name} processes all objects at once; run it without --object and --shard")
        return ()
    shards = DataDirectory(request.data).check_shard_count(request.shards)
    if shard is not None and shard >= shards:
        raise StoreError(f"there is no shard {shard} of {shards}: shards are numbered 0 to {shards - 1}")
    object_shard = None if request.only is None else shard_of(request.only, shards)
    if None not in (shard, object_shard) and shard != object_shard:
        raise StoreError(f"object {request.only} is in shard {object_shard} of {shards}, shard {shard} was asked for; leave one out")
    selected = object_shard if shard is None else shard
    return range(shards) if selected is None else [selected]

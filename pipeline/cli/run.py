"""`vt-pipeline run`: make what is not there yet of one stage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, cast

import typer
from rich.console import Console
from rich.markup import escape

from pipeline.cli.explain import explain_folder, explain_shard
from pipeline.cli.messages import fail
from pipeline.cli.request import (
    DataOption,
    ManifestOption,
    ObjectsOption,
    PresetOption,
    SeedOption,
    SetOption,
    failures_as_words,
    make_request,
)
from pipeline.config.manifest import shard_of
from pipeline.console import Meter, console, errors, say
from pipeline.engine.folders import fill, plan_folder
from pipeline.engine.plan import Plan, Request, make_plan
from pipeline.engine.runner import execute
from pipeline.engine.stage import ObjectStage, SetStage
from pipeline.engine.takeover import takeable
from pipeline.engine.workers import Outcome
from pipeline.errors import StoreError
from pipeline.store.record import Record
from pipeline.store.shard import Shard
from stages.registry import STAGES, is_set_stage, load_stage


def run(
    stage: Annotated[str, typer.Argument(help=f"One of {', '.join(STAGES)}.")],
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    objects: ObjectsOption = None,
    shard: Annotated[int | None, typer.Option(min=0, help="Only this shard of --shards.")] = None,
    shards: Annotated[int, typer.Option(min=1, help="How many shards the objects are split into.")] = 1,
    workers: Annotated[int, typer.Option(min=0, help="Processes side by side; 0 for one a core.")] = 0,
    object_id: Annotated[str | None, typer.Option("--object", help="Process only this object.")] = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    strict: Annotated[bool, typer.Option(help="Stop at the first object that fails.")] = False,
    retry: Annotated[bool, typer.Option(help="Try objects again that failed in this stage.")] = False,
    dry_run: Annotated[bool, typer.Option(help="Say what would be done, and do nothing.")] = False,
    explain: Annotated[bool, typer.Option(help="Then say what was modelled and what was left out, and why.")] = False,
) -> None:
    """Run one stage: make what is not there yet."""
    if stage not in STAGES:
        fail(f"there is no stage {stage}; there are {', '.join(STAGES)}")
    if shard is not None and shard >= shards:
        fail(f"--shard {shard} of --shards {shards}: shards are numbered 0 to {shards - 1}")
    if explain and dry_run:
        fail("--explain counts what was made, and --dry-run makes nothing: leave one of them out")
    with failures_as_words():
        loaded = load_stage(stage)
        request = make_request(loaded, manifest, preset, data, objects, assignments or [], seed, shards, workers, strict, retry, object_id)
        if object_id is not None and object_id not in {item.object_id for item in request.objects}:
            fail(f"manifest {request.manifest} has no object {object_id}")
        if is_set_stage(loaded):
            if object_id is not None or shard is not None:
                fail(f"{stage} looks at all objects at once; run it without --object and --shard")
            asked = cast(Request[SetStage], request)
            _foretell_folder(asked) if dry_run else run_folder(asked)
            if explain:
                explain_folder(asked)
            return
        for number in range(shards) if shard is None else [shard]:
            of_objects = cast(Request[ObjectStage], request)
            _foretell_shard(of_objects, number) if dry_run else _run_shard(make_plan(of_objects, number))
            if explain:
                explain_shard(make_plan(of_objects, number))


def _foretell_folder(request: Request[SetStage]) -> None:
    """Say whether a set stage would run, about how long and how large its folder would be."""
    path = request.data / request.stage.folder(request.settings)
    counted = [item for item in request.objects if item.split in request.stage.splits(request.settings)]
    try:
        if plan_folder(request).up_to_date():
            say(f"{request.stage.name} {path}: up to date, {len(counted)} objects")
            return
    except StoreError:  # an input is not there yet
        pass
    cost = request.stage.cost(request.settings, len(counted))
    size = f"about {cost.seconds / 60:.1f} min on one core and {cost.kilobytes / 1e3:.0f} MB"
    say(f"{request.stage.name} {path}: would look at {len(counted)} objects, {size}")


def run_folder(request: Request[SetStage], place: str | None = None) -> Record:
    """Run a set stage unless its folder, or `place`, is up to date; the folder's record."""
    plan = plan_folder(request, place)
    if plan.up_to_date():
        say(f"{request.stage.name} {plan.path}: up to date, {plan.objects} objects")
    else:
        fill(plan, console)
        say(f"{request.stage.name} {plan.path}: {plan.objects} objects, {Record(plan.path).content['seconds']:.1f} s")
    return Record(plan.path)


def _foretell_shard(request: Request[ObjectStage], number: int) -> None:
    """Say what a run would do, about how long it would take and how large its output would be."""
    name = f"{request.stage.name} {request.data / request.stage.output.name / f'{number:04d}.zarr'}"
    total = len(shard_of(request.objects, number, request.shards))
    try:
        plan = make_plan(request, number)
    except StoreError:  # an input is not there yet: then nothing is here either
        cost, missing, taken = request.stage.cost(request.settings), total, 0
    else:
        if plan.up_to_date():
            say(f"{name}: up to date, {total} objects")
            return
        wanted = {job.key for job in plan.missing()}
        taken = sum(key in wanted for _, _, key in takeable(plan))
        cost, missing = plan.cost(), len(wanted) - taken
    minutes, megabytes = missing * cost.seconds / request.workers / 60, total * cost.kilobytes / 1e3
    over = f", take {taken} over from shards that stand" if taken else ""
    say(f"{name}: would make {missing} of {total} objects{over}, about {minutes:.1f} min and {megabytes:.0f} MB")


def _run_shard(plan: Plan) -> None:
    if plan.request.only is not None and plan.request.only not in {job.item.object_id for job in plan.jobs}:
        return
    if plan.up_to_date():
        say(f"{plan.request.stage.name} {plan.path}: up to date, {len(plan.jobs)} objects")
        for job in plan.jobs:  # a run that was killed while it packed may have left some; those of other settings are another run's
            plan.pieces.path(job.item.object_id, job.key).unlink(missing_ok=True)
    else:
        _watch(console, plan.request.stage.name, len(plan.missing()), execute(plan))
    if not plan.path.exists():
        return
    failures = Shard(plan.path, plan.request.stage.output).attributes["failures"]
    for object_id, failure in failures.items():
        if failure["stage"] == plan.request.stage.name:
            errors.print(f"  [yellow]failed[/] {escape(object_id)}: {escape(failure['reason'])}")
    if failures and plan.request.strict:
        fail(f"{len(failures)} objects have failed, and --strict was asked for")


def _watch(console: Console, title: str, total: int, outcomes: Iterator[Outcome]) -> None:
    """Go through the outcomes of a run, showing how far it is, and end with a line that says what was done."""
    done = failed = 0
    with Meter(console, title, total, "objects") as meter:
        for outcome in outcomes:
            done += 1
            failed += outcome.reason is not None
            meter.advance()
    console.print(f"{title}: made {done} objects in {meter.seconds:.1f} s" + (f", {failed} failed" if failed else ""))

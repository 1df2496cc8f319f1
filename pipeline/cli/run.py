"""`vt-pipeline run`: make the missing rows of one stage."""

import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any

import typer
from rich.markup import escape

from pipeline.cli.completion import complete_object, complete_stage
from pipeline.cli.failures import fail
from pipeline.cli.request import (
    OBJECTS,
    RUN,
    DataOption,
    ExecutorOption,
    ManifestOption,
    ObjectsOption,
    PresetOption,
    SeedOption,
    SetOption,
    ShardsOption,
    UnitsOption,
    UpOption,
    WorkersOption,
    make_executor,
    make_request,
)
from pipeline.config.manifest import load_manifest
from pipeline.console import NAMED, abbreviate, console, errors, pluralise, print_line
from pipeline.engine.plan import Forecast, Plan, Summary
from pipeline.engine.run import forecast, make_plans
from pipeline.engine.run import run as execute
from pipeline.engine.shard_units import failures as failures_of
from pipeline.engine.shard_units import failures_before
from pipeline.engine.stage import DatasetStage, ObjectStage, Stage
from pipeline.errors import closest_name, unknown_name
from pipeline.store.publish import ShardOutput
from pipeline.store.record import Failure
from pipeline.store.storage import Location, on_disk
from stages.registry import STAGES, load_stage


def run(
    stage: Annotated[str, typer.Argument(help=f"One of {', '.join(STAGES)}.", autocompletion=complete_stage)],
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    objects: ObjectsOption = None,
    shard: Annotated[int | None, typer.Option(min=0, help="Only this shard of --shards.", rich_help_panel=RUN)] = None,
    shards: ShardsOption = None,
    executor: ExecutorOption = "processes",
    workers: WorkersOption = 0,
    scheduler: Annotated[
        str | None, typer.Option(help="Use the workers of this Dask scheduler, such as tls://HOST:8786.", rich_help_panel=RUN)
    ] = None,
    object_id: Annotated[
        str | None, typer.Option("--object", help="Process only this object.", rich_help_panel=OBJECTS, autocompletion=complete_object)
    ] = None,
    units: UnitsOption = None,
    up: UpOption = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    strict: Annotated[bool, typer.Option(help="Stop at the first object that fails in this stage.", rich_help_panel=RUN)] = False,
    retry: Annotated[bool, typer.Option(help="Try objects again that failed in this stage.", rich_help_panel=RUN)] = False,
    check: Annotated[bool, typer.Option(help="Verify published rows first, and make damaged ones again.", rich_help_panel=RUN)] = False,
    dry_run: Annotated[bool, typer.Option(help="Print what a run would do, and do nothing.", rich_help_panel=RUN)] = False,
) -> None:
    """Run one stage.

    Objects that are up to date are left alone; a run that was killed continues where it stopped.
    """
    if stage not in STAGES:
        fail(unknown_name("stage", stage, STAGES))
    shared = make_request(
        load_stage(stage), manifest, preset, data=data, objects=objects, assignments=assignments, seed=seed, units=units, up=up
    )
    processes = make_executor(executor, workers, scheduler)
    request = replace(shared, shards=shards, executor=processes, strict=strict, retry=retry, check=check, only=object_id)
    if object_id is not None and object_id not in {item.object_id for item in request.objects}:
        guess = closest_name(object_id, [item.object_id for item in request.objects])
        fail(f"manifest {request.manifest} has no object {object_id}" + (f", did you mean {guess}?" if guess else ""))
    if isinstance(request.stage, DatasetStage) and (object_id is not None or shard is not None):
        fail(f"{stage} looks at all objects at once; run it without --object and --shard")
    if isinstance(request.stage, ObjectStage):
        understood = [] if request.stage.inputs(request.settings) else load_manifest(manifest).remarks(objects)
        for line in (*understood, *request.stage.describe_objects(request.settings, request.objects)):
            print_line(line)
    with processes:
        if dry_run:
            for path, foreseen in forecast(request, shard):
                _print_forecast(request.stage, path, foreseen, check)
            return
        for plan in make_plans(request, shard):
            run_plan(plan)


NO_OBJECT_LEFT = "none of its objects is in the manifest any more"


def _print_forecast(stage: Stage, path: Location, foreseen: Forecast, check: bool) -> None:
    size = f"about {foreseen.seconds / 60:.1f} min and {foreseen.kilobytes / 1e3:.0f} MB"
    if foreseen.up_to_date:
        text = f"up to date, {pluralise(foreseen.total)}" + _failed_text(foreseen.failed, foreseen.failed_before)
    elif not foreseen.total:
        text = f"would be removed, {NO_OBJECT_LEFT}"
    elif isinstance(stage, DatasetStage):
        text = f"would be made from {pluralise(foreseen.total)}, {size}"
    else:
        made = f"make {foreseen.missing} of {pluralise(foreseen.total)}"
        finished = f"verify {pluralise(foreseen.total)}" if check else f"publish {pluralise(foreseen.total, 'finished row')}"
        uncounted = "; damaged rows are not counted" if check and foreseen.missing < foreseen.total else ""
        text = f"would {made if foreseen.missing else finished}, {size}{uncounted}"
    print_line(f"{stage.name} {path}: {text}")


def _failed_text(here: int, before: int) -> str:
    """Write how many objects failed in this stage, and in earlier ones."""
    return (f", {here} failed" if here else "") + (f"; {pluralise(before)} failed in an earlier stage" if before else "")


def run_plan(plan: Plan[Any]) -> None:
    """Run a plan and print what was done, and the reason of each object that failed."""
    stage, request, is_shard = plan.stage.name, plan.request, isinstance(plan.output, ShardOutput)
    result: Summary | None = None
    if plan.up_to_date():
        text = f"up to date, {pluralise(len(plan.units) if is_shard else plan.total)}"
    elif not plan.total:
        execute(plan, console)
        text = f"removed, {NO_OBJECT_LEFT}"
    else:
        _warn_of_low_disk_space(plan)
        if is_shard and request.only is None and (line := _changed_rows(plan)):
            print_line(f"{stage} {plan.path}: {line}")
        for line in _misfits(plan) if is_shard else ():
            print_line(line)
        result = execute(plan, console)
        text = (f"made {pluralise(result.made)}" if is_shard else f"made from {pluralise(plan.total)}") + f" in {result.seconds:.1f} s"
    failures = failures_of(plan) if is_shard else {}  # a folder has none
    text += _failed_text(len(failures), failures_before(plan) if is_shard else 0)
    if result and result.held_back:
        text += (
            "; not published, because the others are damaged, have left the manifest, or were made with other settings, inputs or "
            f"code: run without --object, or, to look at {request.only} alone, run each stage from {next(iter(STAGES))} with another --data"
        )
    elif result and plan.missing:
        text += f"; {pluralise(len(plan.missing))} of {plan.total} not made yet"
    print_line(f"{stage} {plan.path}: {text}")
    if result and is_shard and plan.output.shard is not None:
        for line in plan.stage.describe_shard(plan.settings, plan.output.shard):
            print_line(line)
    _print_failures(failures)
    if failures and request.strict:
        fail(f"{pluralise(len(failures))} failed, and --strict was asked for")


def _warn_of_low_disk_space(plan: Plan[Any]) -> None:
    """Warn where the disk has less room than the stage expects to write."""
    folder = on_disk(plan.request.data)
    if folder is None:
        return
    if isinstance(plan.output, ShardOutput):
        kilobytes = plan.total * plan.stage.cost(plan.settings).kilobytes  # a shard is written as a whole
    else:
        kilobytes = plan.stage.cost_of(plan.settings, plan.request.objects)[1].kilobytes
    free = shutil.disk_usage(next(path for path in (folder, *folder.absolute().parents) if path.exists())).free
    if 1000 * kilobytes > free:
        errors.print(
            f"[yellow]warning:[/] {plan.stage.name} writes about {kilobytes / 1e3:.0f} MB, and {free / 1e6:.0f} MB are free for "
            f"{escape(str(folder))}; make room, or name another --data (make: DATA=)"
        )


def _changed_rows(plan: Plan[ShardOutput]) -> str:
    """Name the published rows whose objects have left the manifest, and count those that change their split."""
    splits = {unit.name: unit.split for unit in plan.units}
    rows = plan.output.record.rows if plan.output.record else ()
    gone = [row.object_id for row in rows if row.object_id not in splits]
    moved = sum(row.split != splits.get(row.object_id, row.split) for row in rows)
    lines = [f"{pluralise(len(gone))} no longer in the manifest ({abbreviate(gone)}), whose rows are dropped"] if gone else []
    return "; ".join(lines + ([f"{pluralise(moved)} in another split than before"] if moved else []))


def _misfits(plan: Plan[ShardOutput]) -> Iterator[str]:
    """Yield what the stage reports of the inputs of the requested objects."""
    units = [unit for unit in plan.units if plan.request.only in (None, unit.name) and not unit.failure]
    objects = ((unit.name, {inputs.artifact.name: inputs.view(unit.name) for inputs in plan.inputs}) for unit in units)
    yield from plan.stage.describe_misfits(plan.settings, objects)


def _print_failures(failures: Mapping[str, Failure]) -> None:
    """Print the objects that failed, grouped by reason."""
    alike: dict[str, list[str]] = {}
    for object_id, failure in failures.items():
        alike.setdefault(re.sub(rf"^{re.escape(object_id)}\b", "…", failure.reason), []).append(object_id)
    for shared, names in alike.items():
        reason = shared if len(names) > 1 else failures[names[0]].reason
        listed = abbreviate(names) + (f" ({len(names)} objects)" if len(names) > NAMED else "")
        errors.print(f"  [yellow]failed[/] {escape(listed)}: {escape(reason)}")

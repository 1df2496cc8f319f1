"""`vt-pipeline run`: make what is not there yet of one stage."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

import typer
from rich.markup import escape

from pipeline.cli.failures import fail
from pipeline.cli.request import (
    DataOption,
    ExecutorName,
    ManifestOption,
    ObjectsOption,
    PresetOption,
    SeedOption,
    SetOption,
    UnitsOption,
    UpOption,
    make_executor,
    make_request,
)
from pipeline.config.manifest import load_manifest
from pipeline.console import NAMED, console, counted, errors, few, say
from pipeline.engine.plan import Forecast, Plan, Request
from pipeline.engine.process_group import process_group
from pipeline.engine.run import forecast, make_plans
from pipeline.engine.run import run as run_stage
from pipeline.engine.shard import failures as failures_of
from pipeline.engine.stage import DatasetStage
from pipeline.reports.object_fit import size_warnings
from pipeline.store.publish import ShardOutput
from pipeline.store.record import Failure
from pipeline.store.storage import Place
from pipeline.tradeoff.explain import explain_plan
from pipeline.tradeoff.quote import quote
from stages.registry import STAGES, load_stage


def run(
    stage: Annotated[str, typer.Argument(help=f"One of {', '.join(STAGES)}.")],
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    objects: ObjectsOption = None,
    shard: Annotated[int | None, typer.Option(min=0, help="Only this shard of --shards.")] = None,
    shards: Annotated[int | None, typer.Option(min=1, max=9999, help="Into how many; by default the dataset's number, or 1.")] = None,
    executor: Annotated[ExecutorName, typer.Option(help="dask: worker processes; serial: this process alone.")] = ExecutorName.dask,
    workers: Annotated[int, typer.Option(min=0, help="Worker processes on this machine; 0 for one per core.")] = 0,
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler, as tls://HOST:8786, whose workers are used instead.")] = None,
    object_id: Annotated[str | None, typer.Option("--object", help="Process only this object.")] = None,
    units: UnitsOption = None,
    up: UpOption = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    strict: Annotated[bool, typer.Option(help="Stop at the first object that fails.")] = False,
    retry: Annotated[bool, typer.Option(help="Try objects again that failed in this stage.")] = False,
    check: Annotated[bool, typer.Option(help="Read what is there first, and make again what is damaged.")] = False,
    dry_run: Annotated[bool, typer.Option(help="Say what would be done, and do nothing.")] = False,
    explain: Annotated[bool, typer.Option(help="Then say what was modelled and what was left out, and why.")] = False,
) -> None:
    """Run one stage: make what is not there yet."""
    console.quiet = (together := process_group()) is not None and together.rank > 0  # one of several processes speaks
    if stage not in STAGES:
        fail(f"there is no stage {stage}; there are {', '.join(STAGES)}")
    if explain and dry_run:
        fail("--explain counts what was made, and --dry-run makes nothing: leave one of them out")
    shared = make_request(
        load_stage(stage), manifest, preset, data=data, objects=objects, assignments=assignments, seed=seed, units=units, up=up
    )
    processes = make_executor(executor, workers, scheduler)
    request = replace(shared, shards=shards, executor=processes, strict=strict, retry=retry, check=check, only=object_id)
    if object_id is not None and object_id not in {item.object_id for item in request.objects}:
        fail(f"manifest {request.manifest} has no object {object_id}")
    if isinstance(request.stage, DatasetStage) and (object_id is not None or shard is not None):
        fail(f"{stage} looks at all objects at once; run it without --object and --shard")
    if stage == "sample-surfaces":
        _say_how_files_are_read(request, load_manifest(manifest).left_out(objects))
    with processes:
        if dry_run:
            for path, foreseen in forecast(request, shard):
                _print_forecast(stage, path, foreseen)
            return
        for plan in make_plans(request, shard):
            run_plan(plan)
            if explain:
                _print_explanation(plan)


NO_OBJECT_LEFT = "none of its objects is in the manifest any more"


def _print_forecast(stage: str, path: Place, foreseen: Forecast) -> None:
    if foreseen.up_to_date:
        say(f"{stage} {path}: up to date, {counted(foreseen.total)}")
        return
    if not foreseen.total:
        say(f"{stage} {path}: would be removed, {NO_OBJECT_LEFT}")
        return
    size = f"about {foreseen.seconds / 60:.1f} min and {foreseen.kilobytes / 1e3:.0f} MB"
    say(f"{stage} {path}: would make {foreseen.missing} of {counted(foreseen.total)}, {size}")


def run_plan(plan: Plan[Any]) -> None:
    """Run a plan and say what was done; an object that failed is named with its reason."""
    stage, request = plan.stage.name, plan.request
    failures: dict[str, Failure] = {}
    if plan.up_to_date():
        say(f"{stage} {plan.path}: up to date, {counted(plan.total)}")
    elif not plan.total:
        run_stage(plan, console)
        say(f"{stage} {plan.path}: removed, {NO_OBJECT_LEFT}")
    else:
        for line in size_warnings(plan) if isinstance(plan.output, ShardOutput) else ():
            say(line)
        result = run_stage(plan, console)
        what = f"made {counted(result.made)}" if isinstance(plan.output, ShardOutput) else f"made from {counted(plan.total)}"
        left = f"; {result.waiting} of {plan.total} not made yet, run without --object to publish the shard" if result.waiting else ""
        failures = failures_of(plan) if isinstance(plan.output, ShardOutput) else {}
        say(f"{stage} {plan.path}: {what} in {result.seconds:.1f} s" + (f", {len(failures)} failed" if failures else "") + left)
        if stage == "sample-surfaces" and isinstance(plan.output, ShardOutput):
            _say_what_is_missing(plan)
    failures = failures or (failures_of(plan) if isinstance(plan.output, ShardOutput) else {})
    _print_failures({name: failure for name, failure in failures.items() if request.only in (None, name)})
    if failures and request.strict:
        fail(f"{counted(len(failures))} failed, and --strict was asked for")


def _say_how_files_are_read(request: Request[Any], left_out: Mapping[str, list[str]]) -> None:
    """Say what of a folder is left out, and that files without units are scaled to one size."""
    for reason, files in left_out.items():
        say(f"left out {counted(len(files), 'file')} ({few(files)}): {reason}")
    unitless = sum("file" in item.source and item.source.get("metres_per_unit") is None for item in request.objects)
    if unitless:
        size = getattr(request.settings, "diagonal", 0.5)
        say(f"{counted(unitless)} scaled to a diagonal of {size:g} m; --units mm (make: UNITS=mm), or another unit, keeps real sizes")


def _say_what_is_missing(plan: Plan[ShardOutput]) -> None:
    """Name the objects whose textures or materials are not there: they are rendered without."""
    shard = plan.output.shard
    if shard is None or not shard.has("missing_files"):
        return
    counts = shard.read("missing_files")
    names = [name for name, row in shard.position.items() if counts[row]]
    if names:
        say(f"{counted(len(names))} drawn without textures or materials that are not below their folder ({few(names)})")


def _print_failures(failures: Mapping[str, Failure]) -> None:
    """Name the objects that failed, those with one reason together."""
    alike: dict[str, list[str]] = {}
    for object_id, failure in failures.items():
        alike.setdefault(re.sub(rf"^{re.escape(object_id)}\b", "…", failure.reason), []).append(object_id)
    for shared, names in alike.items():
        reason = shared if len(names) > 1 else failures[names[0]].reason
        listed = few(names) + (f" ({len(names)} objects)" if len(names) > NAMED else "")
        errors.print(f"  [yellow]failed[/] {escape(listed)}: {escape(reason)}")


def _print_explanation(plan: Plan[Any]) -> None:
    """Explain what has just been made, or was up to date."""
    explanation, request = explain_plan(plan), plan.request
    if explanation is not None:
        say(explanation.title)
        console.print(explanation.table())
        if known := quote(plan.stage.name, request.settings):
            say(f"error, {known}")
    elif request.only is None:  # else it is in another shard, or failed, and that has been said
        say(f"{plan.stage.name} {plan.path}: {'every object failed' if plan.total else 'no objects'}, there is nothing to explain")

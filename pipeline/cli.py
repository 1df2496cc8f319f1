"""The command line: `vt-pipeline run STAGE` and what looks at a data directory."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.manifest import ManifestError, load_manifest, shard_of
from pipeline.plan import Plan, Request, make_plan
from pipeline.presets import SettingsError, load_presets, resolve
from pipeline.progress import watch
from pipeline.runner import execute
from pipeline.stage import ObjectError, StageError
from pipeline.store.shard import Shard, StoreError
from pipeline.takeover import takeable
from stages.registry import STAGES, load_stage

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_show_locals=False, help=__doc__)
WIDE = 160
"""Columns where no terminal says how many it has: a table in a log is not squeezed."""

console, errors = (
    Console(stderr=stderr, highlight=False, soft_wrap=True, width=None if stream.isatty() else WIDE)
    for stderr, stream in ((False, sys.stdout), (True, sys.stderr))
)


def say(line: str) -> None:
    """Print a line as it is."""
    console.print(escape(line))


def fail(message: object) -> NoReturn:
    """Say what is wrong and end with status 1."""
    errors.print(f"[bold red]error:[/] {escape(str(message))}")
    raise typer.Exit(1)


ManifestOption = Annotated[str, typer.Option(help="A built-in manifest, or the path of a YAML file.")]
PresetOption = Annotated[str, typer.Option(help=f"One of {', '.join(load_presets())}.")]
DataOption = Annotated[Path | None, typer.Option(help="Data directory; by default data/MANIFEST/PRESET.")]


def a_stage_has(knob: str) -> bool:
    """Whether any stage has a knob of this name, or the one before its dot."""
    owner, _, field = knob.rpartition(".")
    return any(field in load_stage(name).settings_type.model_fields for name in ([owner] if owner else STAGES))


def data_directory(data: Path | None, manifest: str, preset: str) -> Path:
    """The data directory asked for, or the one that belongs to manifest and preset."""
    return data or Path("data") / Path(manifest).stem / preset


@app.command()
def run(
    stage: Annotated[str, typer.Argument(help=f"One of {', '.join(STAGES)}.")],
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    objects: Annotated[Path | None, typer.Option(help="Folder of meshes, for manifests that name none.")] = None,
    shard: Annotated[int | None, typer.Option(min=0, help="Only this shard of --shards.")] = None,
    shards: Annotated[int, typer.Option(min=1, help="How many shards the objects are split into.")] = 1,
    workers: Annotated[int, typer.Option(min=0, help="Processes side by side; 0 for one a core.")] = 0,
    object_id: Annotated[str | None, typer.Option("--object", help="Process only this object.")] = None,
    assignments: Annotated[list[str] | None, typer.Option("--set", help="STAGE.KNOB=VALUE, or KNOB=VALUE wherever there is one.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Root seed, instead of the manifest's.")] = None,
    strict: Annotated[bool, typer.Option(help="Stop at the first object that fails.")] = False,
    retry: Annotated[bool, typer.Option(help="Try objects again that failed in this stage.")] = False,
    dry_run: Annotated[bool, typer.Option(help="Say what would be done, and do nothing.")] = False,
) -> None:
    """Run one stage: make what is not there yet."""
    if stage not in STAGES:
        fail(f"there is no stage {stage}; there are {', '.join(STAGES)}")
    if shard is not None and shard >= shards:
        fail(f"--shard {shard} of --shards {shards}: shards are numbered 0 to {shards - 1}")
    if (where := data_directory(data, manifest, preset)).is_file():
        fail(f"--data {where} is a file; name a folder")
    try:
        loaded, described = load_stage(stage), load_manifest(manifest)
        request = Request(
            stage=loaded,
            settings=resolve(loaded, preset, assignments or [], STAGES, a_stage_has),
            manifest=described.name,
            objects=described.objects(objects),
            preset=preset,
            seed=described.seed if seed is None else seed,
            data=where,
            shards=shards,
            workers=workers or len(os.sched_getaffinity(0)),
            strict=strict,
            retry=retry,
            only=object_id,
        )
        if object_id is not None and object_id not in {item.object_id for item in request.objects}:
            fail(f"manifest {described.name} has no object {object_id}")
        for number in range(shards) if shard is None else [shard]:
            if dry_run:
                _foretell(request, number)
            else:
                _run_shard(make_plan(request, number))
    except (ManifestError, SettingsError, StageError, StoreError, ObjectError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail("interrupted; what is finished is kept, run the same command to go on")


def _foretell(request: Request, number: int) -> None:
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
        plan.pieces.discard(job.item.object_id for job in plan.jobs)  # a run that was killed while it packed may have left some
    else:
        watch(console, plan.request.stage.name, len(plan.missing()), execute(plan))
    if not plan.path.exists():
        return
    failures = Shard(plan.path, plan.request.stage.output).attributes["failures"]
    for object_id, failure in failures.items():
        if failure["stage"] == plan.request.stage.name:
            errors.print(f"  [yellow]failed[/] {escape(object_id)}: {escape(failure['reason'])}")
    if failures and plan.request.strict:
        fail(f"{len(failures)} objects have failed, and --strict was asked for")


@app.command()
def stages() -> None:
    """List the stages, what each reads and writes, and every knob."""
    for name in STAGES:
        stage = load_stage(name)
        reads = ", ".join(artifact.name for artifact in stage.inputs) or "the manifest's meshes"
        console.print(f"[bold]{name}[/]  {stage.summary}\n  reads {reads}; writes {stage.output.name}")
        table = Table("knob", "default", "changes", "why", box=None, pad_edge=True, padding=(0, 2))
        for knob, info in stage.settings_type.model_fields.items():
            table.add_row(knob, str(info.default), stage.settings_type.changes(knob), info.description)
        console.print(table)


@app.command()
def status(
    data: Annotated[Path, typer.Argument(help="Data directory.")],
    as_json: Annotated[bool, typer.Option("--json", help="Everything, as JSON.")] = False,
) -> None:
    """Say what is in a data directory: objects, failures with their reasons, digests."""
    from pipeline import status as report

    try:
        found = report.read(data)
    except StoreError as error:
        fail(error)
    if as_json:
        typer.echo(report.to_json(found))
    else:
        report.show(found, console)


@app.command()
def validate(data: Annotated[Path, typer.Argument(help="A data directory, or one shard in it.")]) -> None:
    """Check every shard against its schema and its digests; ends with status 1 when one is not as it should be."""
    from pipeline.store.validate import problems_below

    found = problems_below(data)
    for path, lines in found.items():
        console.print(f"{path}: {'[green]valid[/]' if not lines else '[red]not valid[/]'}")
        for line in lines:
            console.print(f"  {escape(line)}")
    if not found:
        fail(f"{data.resolve()} holds no shards; looked for NAME/NNNN.zarr")
    if any(found.values()):
        raise typer.Exit(1)


@app.command()
def doctor() -> None:
    """Check that everything the stages need is installed, and say how to get what is not."""
    from pipeline.doctor import examine

    healthy = True
    for check in examine():
        console.print(f"[{'green' if check.ok else 'red'}]{'ok' if check.ok else 'missing':8}[/]{escape(check.what)}")
        if not check.ok:
            console.print(f"        {escape(check.remedy)}")
            healthy = False
    if not healthy:
        raise typer.Exit(1)


@app.command()
def summary(
    data: Annotated[Path, typer.Argument(help="Data directory.")],
    most: Annotated[int, typer.Option(min=1, help="Draw at most so many objects, spread evenly.")] = 40,
) -> None:
    """Print a data set's statistics beside the supplement's, and draw its contact sheets."""
    from pipeline import statistics
    from pipeline.summary import contact_sheets

    try:
        say(str(data.resolve()))
        statistics.show(statistics.tally(data), console)
        for path in contact_sheets(data, most):
            say(f"contact sheet: {path}")
    except StoreError as error:
        fail(error)

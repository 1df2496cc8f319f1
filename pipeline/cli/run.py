"""`vt-pipeline run`: make the missing rows of one stage."""

import re
from typing import Annotated

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
)
from pipeline.config.manifest import load_manifest
from pipeline.console import NAMED, abbreviate, console, errors, print_line
from pipeline.engine.make import make
from pipeline.engine.plan import Made
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location
from stages.registry import STAGES, make_request


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
    reuse: Annotated[
        str | None,
        typer.Option(help="Copy rows with equal keys from this data directory, e.g. of another number of shards.", rich_help_panel=RUN),
    ] = None,
    dry_run: Annotated[bool, typer.Option(help="Print what a run would do, and do nothing.", rich_help_panel=RUN)] = False,
) -> None:
    """Run one stage.

    Objects that are up to date are left alone; a run that was killed continues where it stopped.
    """
    processes = make_executor(executor, workers, scheduler)
    request = make_request(
        stage,
        manifest,
        preset,
        data=data,
        objects=objects,
        assignments=assignments or (),
        seed=seed,
        units=units,
        up=up,
        shards=shards,
        executor=processes,
        strict=strict,
        retry=retry,
        check=check,
        only=object_id,
        reuse=reuse and as_location(reuse),
    )
    if reuse and not DataDirectory(reuse).is_data_directory():
        fail(f"--reuse {reuse} is no data directory; name one that `vt-pipeline run` made")
    understood = [] if request.stage.inputs(request.settings) else load_manifest(manifest).remarks(objects)
    for line in (*understood, *request.stage.describe_objects(request.settings, request.objects)):
        print_line(line)
    with processes:
        make(request, console, shard, dry_run=dry_run, report=print_made)


def print_made(made: Made) -> None:
    """Print what was made, or would be, and the objects that failed, grouped by reason."""
    for line in (f"{made.stage} {made.path}: {made.text}", *made.notes):
        print_line(line)
    alike: dict[str, list[str]] = {}
    for object_id, failure in made.failures.items():
        alike.setdefault(re.sub(rf"^{re.escape(object_id)}\b", "…", failure.reason), []).append(object_id)
    for shared, names in alike.items():
        reason = shared if len(names) > 1 else made.failures[names[0]].reason
        listed = abbreviate(names) + (f" ({len(names)} objects)" if len(names) > NAMED else "")
        errors.print(f"  [yellow]failed[/] {escape(listed)}: {escape(reason)}")

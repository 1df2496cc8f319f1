"""Commands that inspect description files, the stages, a data directory and the machine."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from typer import Argument, Option

from pipeline.cli import options
from pipeline.cli.failures import fail
from pipeline.cli.options import DataArgument
from pipeline.config.settings import value_text
from pipeline.console import Row, Table, console, errors, print_lines, show_tables
from pipeline.errors import InvalidInput, PipelineError
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location
from schemas.catalogue import ARTIFACTS
from stages.registry import STAGES, load_stage


def check(
    file: Annotated[
        str,
        Argument(
            help="A hand, sensor, scene, manifest or observation file, or the name of a shipped one.",
            autocompletion=options.complete_described("hand", "sensor", "scene", "manifest"),
        ),
    ],
    picture: Annotated[Path | None, Option(help="PNG to draw it in; by default NAME.png in the current folder.")] = None,
    models: Annotated[str | None, Option(help="Folder of trained models, for an observation; by default the pretrained ones.")] = None,
    configuration: Annotated[
        str | None, Option(help="Which of MODELS; by default occluded-touch; pretrained: by the object's size.")
    ] = None,
    objects: options.ObjectsOption = None,
    units: options.UnitsOption = None,
    up: options.UpOption = None,
) -> None:
    """Check and draw a hand, sensor, scene, manifest or observation file.

    All faults are named at once; with one, the exit status is 1. A manifest's objects are all read: sizes, units, faces, textures. An
    observation is checked as `predict` does before it runs.
    """
    from pipeline.checks.description_checks import check_file, described_file
    from pipeline.checks.manifest_check import MeshFiles

    described = described_file(file, picture)
    path, kind, drawing = described
    meshes = None if objects is None and units is None and up is None else MeshFiles(objects, units, up)
    if kind == "observation" and meshes is None:
        from pipeline.reconstruct.observation_picture import draw_observation
        from pipeline.reconstruct.predict import PredictOptions

        lines = draw_observation(path, drawing, PredictOptions(models, configuration).reader(path).target)
    elif models is not None or configuration is not None:
        option = f"--models {models}" if configuration is None else f"--configuration {configuration}"
        raise InvalidInput(f"{path} is a {kind} file; only an observation is checked against models: leave out {option}")
    else:
        lines = check_file(described, meshes)
    print_lines(*lines)
    if any(line.startswith("fault:") for line in lines):
        raise typer.Exit(1)


def stages() -> None:
    """List the stages with inputs, outputs and settings."""
    for name in STAGES:
        try:
            stage = load_stage(name)
        except PipelineError as error:  # of a plugin; the other stages are listed all the same
            errors.print(f"[bold]{name}[/]  [red]{escape(str(error))}[/]")
            continue
        settings = stage.settings_type()
        reads = ", ".join(stage.reads(settings)) or "the manifest's meshes"
        console.print(f"[bold]{name}[/]  {stage.summary}\n  reads {reads}; writes {stage.writes(settings)}")
        rows = [
            Row([setting, value_text(info.default), stage.settings_type.changes(setting), info.description])
            for setting, info in stage.settings_type.model_fields.items()
        ]
        show_tables([Table("", ["setting", "default", "changes", "why"], rows)])


def status(data: DataArgument, as_json: Annotated[bool, Option("--json", help="Print everything as JSON.")] = False) -> None:
    """Show contents, failures and Slurm jobs of a data directory."""
    from pipeline.tables import status as report

    directory = as_location(data)
    account = report.read_account(directory)
    if as_json:
        typer.echo(account.to_json())
    elif not (account.artifacts or account.folders or account.damaged or account.other_versions or account.jobs):
        print_lines(f"{directory.resolve()}: nothing has been made here")
    else:
        report.show(account, console)
    if account.damaged:
        raise typer.Exit(1)


def summary(
    data: DataArgument,
    most: Annotated[int, Option(min=1, help="Maximum number of objects to draw, spread evenly.")] = 40,
) -> None:
    """Print a dataset's statistics; draw sheets, and animations of slides and lifts."""
    from pipeline.drawing.contact_sheet import SHOWN, contact_sheets, sequence_animations
    from pipeline.tables.touch_tables import read_touches, sequence_tables, touch_tables

    directory = as_location(data)
    DataDirectory(directory).check_exists()
    print_lines(directory.resolve())
    if tables := sequence_tables(directory):
        show_tables(tables)
        print_lines(*(f"animation: {path}" for path in sequence_animations(directory)))
        if not DataDirectory(directory).collection(ARTIFACTS["grasps"]).shards:
            return
    show_tables(touch_tables(read_touches(directory)))
    if missing := [name for name in SHOWN if not DataDirectory(directory).collection(ARTIFACTS[name]).shards]:
        print_lines(f"no contact sheets: {' and '.join(missing)} {'have' if len(missing) > 1 else 'has'} not been made")
    else:
        print_lines(*(f"contact sheet: {path}" for path in contact_sheets(directory, most)))


def validate(
    data: DataArgument,
    strict: Annotated[bool, Option(help="Also reject artifacts that several kinds of processors computed.")] = False,
    recipe: Annotated[Path | None, Option(help="Also compare the rows with those of this recipe.")] = None,
) -> None:
    """Check a data directory against schemas and digests.

    Exits with status 1 if a check fails.
    """
    from pipeline.cli.share import print_comparison
    from pipeline.drawing.written_files import report_problems
    from pipeline.recipes.dataset_recipe import compare
    from pipeline.recipes.recipe import read_recipe
    from pipeline.store.validate import problems_below

    expected = read_recipe(recipe) if recipe else None
    problems = problems_below(as_location(data), strict=strict)
    if not problems:
        fail(f"{as_location(data).resolve()} holds no records; looked for ARTIFACT/NNNN-of-NNNN.json")
    problems |= report_problems(as_location(data))
    for path, lines in problems.items():
        console.print(f"{escape(str(path))}: {'[green]valid[/]' if not lines else '[red]not valid[/]'}")
        print_lines(*(f"  {line}" for line in lines))
    equal = expected is None or print_comparison(compare(expected, DataDirectory(data)), recipe)
    if any(problems.values()) or not equal:
        raise typer.Exit(1)


def collect_garbage(
    data: DataArgument,
    older_than: Annotated[float, Option(min=0, help="Minimum age in minutes: readers may still use newer files.")] = 60.0,
) -> None:
    """Remove replaced groups and folders, and those that killed runs wrote.

    Unfinished objects and trainings stay for the run that continues them, in object storage for a week. Symbolic links are not followed.
    """
    from pipeline.store.garbage import collect_everything, links

    directory = DataDirectory(data)
    directory.check_exists()
    removed = collect_everything(directory, 60 * older_than)
    print_lines(*(f"removed {path}" for path in removed))
    for link in links(directory):
        print_lines(f"{link} is a symbolic link: nothing is removed from {link.resolve()}; move that folder here, or remove there by hand")
    print_lines(f"{data}: {len(removed)} removed")


def doctor() -> None:
    """Check that everything the stages need is installed."""
    from pipeline.checks.doctor import examine

    healthy = True
    for check in examine():
        console.print(f"[{'green' if check.ok else 'red'}]{'ok' if check.ok else 'missing':8}[/]{escape(check.subject)}")
        if not check.ok:
            print_lines(f"        {check.remedy}")
            healthy = False
    if not healthy:
        raise typer.Exit(1)

"""Commands that inspect the stages, a data directory and the machine."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from pipeline.cli.failures import fail
from pipeline.cli.request import DataArgument
from pipeline.config.settings import value_text
from pipeline.console import console, errors, print_line, show_tables
from pipeline.errors import PipelineError
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location
from schemas.catalogue import ARTIFACTS
from stages.registry import STAGES, load_stage


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
        table = Table("setting", "default", "changes", "why", box=None, pad_edge=True, padding=(0, 2))
        for setting, info in stage.settings_type.model_fields.items():
            table.add_row(setting, escape(value_text(info.default)), stage.settings_type.changes(setting), info.description)
        console.print(table)


def status(data: DataArgument, as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False) -> None:
    """Show contents, failures and Slurm jobs of a data directory."""
    from pipeline.cluster.slurm import jobs_account
    from pipeline.tables import status as report

    directory = as_location(data)
    account = report.read_account(directory, lambda: jobs_account(directory))
    if as_json:
        typer.echo(account.to_json())
    elif not (account.artifacts or account.folders or account.damaged or account.other_versions or account.jobs):
        print_line(f"{directory.resolve()}: nothing has been made here")
    else:
        report.show(account, console)
    if account.damaged:
        raise typer.Exit(1)


def collect_garbage(
    data: DataArgument,
    older_than: Annotated[float, typer.Option(min=0, help="Minimum age in minutes: readers may still use newer files.")] = 60.0,
) -> None:
    """Remove replaced groups and folders, and those that killed runs wrote.

    Unfinished objects and trainings stay for the run that continues them, in object storage for a week. Symbolic links are not followed.
    """
    from pipeline.store.garbage import collect_everything, links

    directory = DataDirectory(data)
    if not directory.is_data_directory():
        fail(f"{data} is not a data directory: it has no dataset.json, and no record")
    removed = collect_everything(directory, 60 * older_than)
    for path in removed:
        print_line(f"removed {path}")
    for link in links(directory):
        print_line(f"{link} is a symbolic link: nothing is removed from {link.resolve()}; move that folder here, or remove there by hand")
    print_line(f"{data}: {len(removed)} removed")


def validate(
    data: DataArgument,
    strict: Annotated[bool, typer.Option(help="Also reject artifacts that several kinds of processors computed.")] = False,
    recipe: Annotated[Path | None, typer.Option(help="Also compare the rows with those of this recipe.")] = None,
) -> None:
    """Check a data directory against schemas and digests.

    Exits with status 1 if a check fails.
    """
    from pipeline.cli.recipe import print_comparison
    from pipeline.drawing.written_files import report_problems
    from pipeline.recipes.dataset_recipe import compare
    from pipeline.recipes.recipe import read_recipe
    from pipeline.store.validate import problems_below

    expected = read_recipe(recipe) if recipe else None
    problems = problems_below(as_location(data), strict=strict)
    if problems:
        problems |= report_problems(as_location(data))
    for path, lines in problems.items():
        console.print(f"{escape(str(path))}: {'[green]valid[/]' if not lines else '[red]not valid[/]'}")
        for line in lines:
            print_line(f"  {line}")
    if not problems:
        fail(f"{as_location(data).resolve()} holds no records; looked for ARTIFACT/NNNN-of-NNNN.json")
    equal = expected is None or print_comparison(compare(expected, DataDirectory(data)), recipe)
    if any(problems.values()) or not equal:
        raise typer.Exit(1)


def doctor() -> None:
    """Check that everything the stages need is installed."""
    from pipeline.checks.doctor import examine

    healthy = True
    for check in examine():
        console.print(f"[{'green' if check.ok else 'red'}]{'ok' if check.ok else 'missing':8}[/]{escape(check.subject)}")
        if not check.ok:
            print_line(f"        {check.remedy}")
            healthy = False
    if not healthy:
        raise typer.Exit(1)


def summary(
    data: DataArgument,
    most: Annotated[int, typer.Option(min=1, help="Maximum number of objects to draw, spread evenly.")] = 40,
) -> None:
    """Print a dataset's statistics and draw its contact sheets."""
    from pipeline.drawing.contact_sheet import SHOWN, contact_sheets
    from pipeline.tables.touch_tables import read_touches, touch_tables

    directory = as_location(data)
    print_line(str(directory.resolve()))
    show_tables(console, touch_tables(read_touches(directory)))
    missing = [name for name in SHOWN if not DataDirectory(directory).collection(ARTIFACTS[name]).shards]
    if missing:
        print_line(f"no contact sheets: {' and '.join(missing)} {'have' if len(missing) > 1 else 'has'} not been made")
        return
    for path in contact_sheets(directory, most):
        print_line(f"contact sheet: {path}")

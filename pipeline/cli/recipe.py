"""`vt-pipeline recipe` and `vt-pipeline remake`: write a dataset's recipe, make the dataset again, and compare."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from pipeline.cli.failures import fail
from pipeline.cli.request import (
    DataArgument,
    ExecutorOption,
    ObjectsOption,
    ShardsOption,
    UnitsOption,
    UpOption,
    WorkersOption,
    make_executor,
)
from pipeline.cli.run import print_made
from pipeline.console import abbreviate, console, pluralise, print_line
from pipeline.engine.make import make
from pipeline.formats.file_content import expanded
from pipeline.recipes.dataset_recipe import Comparison, compare, recipe_of
from pipeline.recipes.recipe import read_recipe
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location, on_disk


def recipe(
    data: DataArgument,
    manifest: Annotated[str | None, typer.Option(help="Its manifest; by default the one that its records name.")] = None,
    objects: ObjectsOption = None,
    units: UnitsOption = None,
    up: UpOption = None,
    files_url: Annotated[
        str | None, typer.Option(help="Web address of those files of your own hand, sensor and scene of which it has the SHA-256 alone.")
    ] = None,
    rows: Annotated[bool, typer.Option(help="Write the whole digest of every row, not its first 16 digits.")] = False,
) -> None:
    """Print a dataset's recipe: what makes it, and digests.

    `vt-pipeline remake` makes the dataset from it again. Redirect it into a file, such as my.recipe.yaml.
    """
    typer.echo(recipe_of(as_location(data), manifest, objects, units=units, up=up, files_url=files_url, full_digests=rows).text(), nl=False)


def remake(
    recipe: Annotated[Path, typer.Argument(help="A recipe, as `vt-pipeline recipe` prints it.")],
    data: Annotated[str, typer.Option(help="Directory or s3://BUCKET/PREFIX to make the dataset in.")],
    objects: ObjectsOption = None,
    descriptions: Annotated[
        Path | None,
        typer.Option(help="Folder for hand, sensor and scene files that come with no package; by default `descriptions` in DATA."),
    ] = None,
    sample: Annotated[int | None, typer.Option(min=1, help="Make this many objects, drawn at random, and compare them.")] = None,
    shards: ShardsOption = None,
    executor: ExecutorOption = "processes",
    workers: WorkersOption = 0,
) -> None:
    """Make a dataset again from its recipe, and compare digests.

    First the sources are compared with the recipe's. Exits with status 1 if a row differs.
    """
    from pipeline.recipes.remake import prepare_remake, reasons, unusual_settings

    published, where = read_recipe(recipe), as_location(data)
    description_folder = expanded(descriptions) if descriptions else (folder / "descriptions" if (folder := on_disk(where)) else None)
    requests = prepare_remake(published, where, objects and expanded(objects), description_folder, sample)
    names = [item.object_id for item in requests[0].objects]
    sampled = len(names) < len(published.rows)
    if sampled and any(DataDirectory(where).artifact_names()):
        fail(f"--data {where} holds a dataset, whose other rows a sample would replace; name a new folder")
    differences = reasons(published)
    print_line(f"{recipe}: {pluralise(len(names))} of {len(published.rows)} to make; their sources are those of the recipe")
    for line in differences:
        print_line(f"  {line}")
    with make_executor(executor, workers, None) as processes:
        for request in requests:
            make(replace(request, shards=shards, executor=processes), console, report=print_made)
    comparison = compare(published, DataDirectory(where), names if sampled else None)
    if print_comparison(comparison, recipe):
        return
    for line in differences or ["code and libraries are those of the recipe: then a setting or digest in it is wrong, or the processor"]:
        print_line(f"  may come of this: {line}")
    for stage in () if differences else comparison.differing:
        if settings := unusual_settings(published, stage):
            print_line(f"  settings of {stage} that differ from preset {published.preset}: {', '.join(settings)}")
    raise typer.Exit(1)


def print_comparison(comparison: Comparison, recipe: object) -> bool:
    """Print how a data directory differs from a recipe, and report whether it is equal."""
    if comparison.equal:
        print_line(f"{recipe}: {pluralise(comparison.compared, 'row')} compared, all equal")
        return True
    console.print(f"{escape(str(recipe))}: [red]differs[/] in {escape(_counted(comparison))}")
    for stage, names in comparison.absent.items():
        print_line(f"  {stage}: no row of {abbreviate(names)} ({pluralise(len(names))}); run the stage, or remake the dataset")
    for stage, names in comparison.differing.items():
        print_line(f"  {stage}: other rows of {', '.join(names)}")
    if comparison.following:
        print_line(
            f"  {pluralise(comparison.following, 'row')} of later stages, made from these, "
            f"{'differ' if comparison.following > 1 else 'differs'} too"
        )
    for line in comparison.remarks:
        print_line(f"  {line}")
    return False


def _counted(comparison: Comparison) -> str:
    rows = sum(map(len, comparison.differing.values())) + comparison.following
    return f"{rows} of {pluralise(comparison.compared, 'row')}"

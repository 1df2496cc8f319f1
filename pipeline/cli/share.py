"""`vt-pipeline recipe`, `remake` and `export`: write a dataset's recipe, make it again and compare, or write it for other programs."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from inspect import signature
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer import Argument, Option

from pipeline import plugins
from pipeline.cli import options
from pipeline.cli.failures import fail
from pipeline.cli.run import print_made
from pipeline.console import abbreviate, console, pluralise, print_lines
from pipeline.engine.make import make
from pipeline.formats.file_content import expanded
from pipeline.recipes.dataset_recipe import Comparison, compare, recipe_of
from pipeline.recipes.recipe import read_recipe
from pipeline.store.atomic import UNFINISHED, atomic_writes, move_files
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location, list_folder, on_disk


def recipe(
    data: options.DataArgument,
    manifest: Annotated[str | None, Option(help="Its manifest; by default the one that its records name.")] = None,
    objects: options.ObjectsOption = None,
    units: options.UnitsOption = None,
    up: options.UpOption = None,
    files_url: Annotated[str | None, Option(help="Address of your hand, sensor and scene files of which it has the SHA-256 alone.")] = None,
    rows: Annotated[bool, Option(help="Write the whole digest of every row, not its first 16 digits.")] = False,
) -> None:
    """Print a dataset's recipe: what makes it, and digests.

    `vt-pipeline remake` makes the dataset from it again. Redirect it into a file, such as my.recipe.yaml.
    """
    typer.echo(recipe_of(as_location(data), manifest, objects, units=units, up=up, files_url=files_url, full_digests=rows).text(), nl=False)


def remake(
    recipe: Annotated[Path, Argument(help="A recipe, as `vt-pipeline recipe` prints it.")],
    data: Annotated[str, Option(help="Directory or s3://BUCKET/PREFIX to make the dataset in.")],
    objects: options.ObjectsOption = None,
    descriptions: Annotated[
        Path | None,
        Option(help="Folder for hand, sensor and scene files that come with no package; by default `descriptions` in DATA."),
    ] = None,
    sample: Annotated[int | None, Option(min=1, help="Make this many objects, drawn at random, and compare them.")] = None,
    shards: options.ShardsOption = None,
    executor: options.ExecutorOption = "processes",
    workers: options.WorkersOption = 0,
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
    print_lines(f"{recipe}: {pluralise(len(names))} of {len(published.rows)} to make; their sources are those of the recipe")
    print_lines(*(f"  {line}" for line in differences))
    with options.make_executor(executor, workers, None) as processes:
        for request in requests:
            make(replace(request, shards=shards, executor=processes), console, report=print_made)
    comparison = compare(published, DataDirectory(where), names if sampled else None)
    if print_comparison(comparison, recipe):
        return
    for line in differences or ["code and libraries are those of the recipe: then a setting or digest in it is wrong, or the processor"]:
        print_lines(f"  may come of this: {line}")
    for stage in () if differences else comparison.differing:
        if settings := unusual_settings(published, stage):
            print_lines(f"  settings of {stage} that differ from preset {published.preset}: {', '.join(settings)}")
    raise typer.Exit(1)


def print_comparison(comparison: Comparison, recipe: object) -> bool:
    """Print how a data directory differs from a recipe, and report whether it is equal."""
    if comparison.equal:
        print_lines(f"{recipe}: {pluralise(comparison.compared, 'row')} compared, all equal")
        return True
    rows = sum(map(len, comparison.differing.values())) + comparison.following
    console.print(f"{escape(str(recipe))}: [red]differs[/] in {rows} of {pluralise(comparison.compared, 'row')}")
    for stage, names in comparison.absent.items():
        print_lines(f"  {stage}: no row of {abbreviate(names)} ({pluralise(len(names))}); run the stage, or remake the dataset")
    for stage, names in comparison.differing.items():
        print_lines(f"  {stage}: other rows of {', '.join(names)}")
    if comparison.following:
        verb = "differ" if comparison.following > 1 else "differs"
        print_lines(f"  {pluralise(comparison.following, 'row')} of later stages, made from these, {verb} too")
    print_lines(*(f"  {line}" for line in comparison.remarks))
    return False


def export(
    data: options.DataArgument,
    out: Annotated[Path, Argument(help="Folder to write; of one object's scene, a .glb file.")],
    to: Annotated[
        str,
        Option(
            help="mesh, webdataset, oxt, grasps, lerobot or parquet (packages of '.\\[export]'), dexgraspbench (packages of "
            "'.\\[mujoco]'), or the name of another package's export.",
            autocompletion=options.complete(lambda: [entry.name for entry in plugins.declared("exports")]),
        ),
    ] = "mesh",
    objects: Annotated[
        list[str] | None,
        Option(
            "--object", help="With --to mesh, grasps or dexgraspbench: only this; repeatable.", autocompletion=options.complete_made_object
        ),
    ] = None,
    of: Annotated[
        str | None, Option(help="With --to lerobot, oxt, parquet, webdataset: slides or lifts, a frame per step; else grasps.")
    ] = None,
    about: Annotated[Path | None, Option(help="With --to parquet: YAML of title, creators, url, licence … for card and Croissant.")] = None,
) -> None:
    """Write a dataset for other programs.

    The formats are LeRobot v3, Hugging Face parquet, WebDataset shards, stores of Open-X-Tactile and glTF scenes, all lossless; and grasps
    for robots: arrays in each object's own frame, or the files of DexGraspBench.
    """
    write = plugins.find("exports", to)
    chosen = list(dict.fromkeys(objects or []))
    given: dict[str, Any] = {name: value for name, value in {"objects": chosen, "about": about, "of": of}.items() if value}
    parameters = signature(write).parameters.keys()
    if refused := sorted(given.keys() - parameters):
        fail(f"--{refused[0].removesuffix('s')} is no option of --to {to}; leave it out")
    one_file, existing = out.suffix.lower() == ".glb", list_folder(out)
    if not one_file and not out.is_dir() and any(map(str.isalpha, out.suffix)):
        fail(f"{out} is named like a {out.suffix} file, which no export writes; name a folder, or of one scene (--object) a .glb file")
    if one_file and len(chosen) != 1:
        fail(f"{out} is one file: name one object with --object, or a folder")
    if (out.is_file() and not one_file) or (existing and UNFINISHED not in existing):
        fail(f"{out} is {'a file' if out.is_file() else 'not empty'}; name a folder that is not there yet")
    if existing:
        print_lines(f"{out}: an earlier export was stopped there; the objects that it finished are kept or written again")
    try:
        with _written(out, one_file) as folder:
            if "publish" in parameters:
                given["publish"] = partial(move_files, folder, out)
            lines = write(as_location(data), folder, **given)
    except BaseException:
        if "publish" in parameters and out.is_dir():
            (out / UNFINISHED).mkdir(exist_ok=True)  # as after a kill: it may be continued
        raise
    print_lines(f"{out}: {lines}")


@contextmanager
def _written(out: Path, one_file: bool) -> Iterator[Path]:
    """Yield an empty folder; at the end its files are moved to `out`, or its one file is."""
    if not one_file:
        with atomic_writes(out) as folder:
            yield folder
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent) as beside:
        yield Path(beside)
        next(Path(beside).iterdir()).replace(out)

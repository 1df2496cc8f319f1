"""`vt-pipeline export`: write a dataset for other programs."""

from collections.abc import Iterator
from contextlib import contextmanager
from inspect import signature
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from pipeline import plugins
from pipeline.cli.completion import complete_export, complete_made_object
from pipeline.cli.failures import fail
from pipeline.cli.request import DataArgument
from pipeline.console import print_line
from pipeline.errors import InvalidInput, unknown_name
from pipeline.store.atomic import UNFINISHED, atomic_writes
from pipeline.store.storage import as_location, list_folder

MESHES = (".obj", ".ply", ".stl", ".off", ".dae", ".gltf", ".3mf")
"""Suffixes of mesh formats that are not written: a folder with such a name would be a mistake."""


def export(
    data: DataArgument,
    out: Annotated[Path, typer.Argument(help="Folder to write; of one object's scene, a .glb file.")],
    to: Annotated[
        str,
        typer.Option(
            help="mesh, webdataset, lerobot or parquet (packages of '.\\[export]'), grasps, dexgraspbench (packages of '.\\[mujoco]'), "
            "or the name of another package's export.",
            autocompletion=complete_export,
        ),
    ] = "mesh",
    objects: Annotated[
        list[str] | None,
        typer.Option("--object", help="With --to mesh: only this object; repeat for several.", autocompletion=complete_made_object),
    ] = None,
    about: Annotated[
        Path | None, typer.Option(help="With --to parquet: a YAML file with title, creators, url, licence … for card and Croissant.")
    ] = None,
) -> None:
    """Write a dataset for other programs.

    The formats are LeRobot v3, Hugging Face parquet, WebDataset shards and glTF scenes, all lossless; and grasps for robots: arrays in each
    object's own frame, or the files of DexGraspBench.
    """
    if out.suffix.lower() in MESHES:
        fail(f"{out}: scenes are written as glTF; name a folder, or of one object (--object) a .glb file")
    entries = {entry.name: entry for entry in plugins.declared("exports")}
    if to not in entries:
        fail(unknown_name("export", to, entries))
    plugins.check_unique("export", to, [plugins.package_of(entry) for entry in plugins.declared("exports") if entry.name == to])
    write = plugins.load(entries[to], InvalidInput)
    chosen = list(dict.fromkeys(objects or []))
    options = {name: value for name, value in {"objects": chosen, "about": about}.items() if value}
    if refused := sorted(options.keys() - signature(write).parameters.keys()):
        fail(f"--{refused[0].removesuffix('s')} is no option of --to {to}; leave it out")
    one_file, existing = out.suffix.lower() == ".glb", list_folder(out)
    if one_file and len(chosen) != 1:
        fail(f"{out} is one file: name one object with --object, or a folder")
    if (out.is_file() and not one_file) or (existing and UNFINISHED not in existing):  # an export that was killed is begun again
        fail(f"{out} is {'a file' if out.is_file() else 'not empty'}; name a folder that is not there yet")
    with _written(out, one_file) as folder:
        lines = write(as_location(data), folder, **options)
    print_line(f"{out}: {lines}")


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

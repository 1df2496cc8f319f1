"""Options shared by the commands that run stages, and the executor made from them."""

import os
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.markup import escape

from pipeline.cli.completion import complete_described, complete_preset, complete_setting
from pipeline.cli.failures import fail
from pipeline.config.settings import load_presets
from pipeline.console import errors
from pipeline.engine.executor import Executor, Serial
from pipeline.engine.worker_processes import WorkerProcesses

Unit = Literal["mm", "cm", "dm", "m", "in", "ft"]
Axis = Literal["x", "y", "z"]
ExecutorName = Literal["processes", "serial"]

OBJECTS, SETTINGS, RUN = "Objects and data", "Settings", "How to run"
"""Panels in which help lists the options."""


DataArgument = Annotated[str, typer.Argument(help="Data directory, or s3://BUCKET/PREFIX.")]
ManifestOption = Annotated[
    str,
    typer.Option(
        help="A built-in manifest, or the path of a YAML file.",
        rich_help_panel=OBJECTS,
        is_eager=True,
        autocompletion=complete_described("manifest"),
    ),
]
PresetOption = Annotated[
    str, typer.Option(help=f"One of {', '.join(load_presets())}.", rich_help_panel=SETTINGS, autocompletion=complete_preset)
]
DataOption = Annotated[
    str | None,
    typer.Option(
        help="Directory or s3://BUCKET/PREFIX; by default data/MANIFEST/PRESET, or data/MANIFEST-OBJECTS/PRESET.", rich_help_panel=OBJECTS
    ),
]
ObjectsOption = Annotated[
    Path | None, typer.Option(help="Folder of meshes, for manifests that name none.", rich_help_panel=OBJECTS, is_eager=True)
]
UnitsOption = Annotated[
    Unit | None,
    typer.Option(
        help="Unit of the mesh files, to keep real sizes; else what they state, or all scaled to one size. A file's own entry comes first.",
        rich_help_panel=OBJECTS,
    ),
]
UpOption = Annotated[
    Axis | None,
    typer.Option(
        help="Axis of the mesh files that points up; by default what they state (glTF: y), else z. A file's own entry comes first.",
        rich_help_panel=OBJECTS,
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="STAGE.SETTING=VALUE, or SETTING=VALUE for every stage that has it.",
        rich_help_panel=SETTINGS,
        autocompletion=complete_setting,
    ),
]
SeedOption = Annotated[int | None, typer.Option(min=0, help="Root seed, instead of the manifest's.", rich_help_panel=SETTINGS)]


ExecutorOption = Annotated[ExecutorName, typer.Option(help="processes: one per core; serial: this process alone.", rich_help_panel=RUN)]
WorkersOption = Annotated[int, typer.Option(min=0, help="Worker processes on this machine; 0 for one per core.", rich_help_panel=RUN)]
ShardsOption = Annotated[
    int | None, typer.Option(min=1, max=9999, help="Number of shards; by default the dataset's, or 1.", rich_help_panel=RUN)
]


def make_executor(name: ExecutorName, workers: int, scheduler: str | None) -> Executor:
    """Make the requested executor, by default with one process per core."""
    if name == "serial":
        if workers or scheduler:
            fail("--executor serial has one process, this one; leave --workers and --scheduler out")
        return Serial()
    if workers and scheduler:
        fail("--scheduler has workers of its own; leave --workers out")
    if scheduler and not scheduler.startswith(("tls://", "wss://", "inproc://")):
        errors.print(
            f"[yellow]warning:[/] whoever reaches {escape(scheduler)} can run code as you, on its workers and here; where others share the "
            "machines or the network, use tls://HOST:8786 and certificates"
        )
    if scheduler:
        from pipeline.engine.dask_executor import Dask

        return Dask(scheduler)
    return WorkerProcesses(workers or len(os.sched_getaffinity(0)))

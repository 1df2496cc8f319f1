"""Options that commands share, how a shell completes them, and the executor made from them."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, cast, get_args, get_origin

import typer
from pydantic.fields import FieldInfo
from typer import Argument, Option

from pipeline.cli.failures import fail
from pipeline.config.manifest import load_manifest
from pipeline.config.settings import load_presets, value_text
from pipeline.console import print_warning
from pipeline.engine.executor import Executor, Serial
from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.errors import PipelineError
from pipeline.formats.description_file import Kind, shipped_files
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from stages.registry import STAGES, load_stage

of_objects, of_settings, of_run = (partial(Option, rich_help_panel=panel) for panel in ("Objects and data", "Settings", "How to run"))


def complete(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Make a function that completes one of the names; the shell completes paths."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def complete_described(*kinds: Kind) -> Callable[[str], list[str]]:
    """Make a function that completes the name of a shipped file of these kinds."""
    return complete(lambda: [name for kind in kinds for name in shipped_files(kind)])


def complete_object(context: typer.Context, incomplete: str) -> list[str]:
    """Complete the name of an object of the manifest; nothing if the manifest needs a folder that is not given."""
    try:
        objects = load_manifest(context.params.get("manifest") or "toy").objects(context.params.get("objects"))
    except (PipelineError, OSError):
        return []
    return complete(lambda: [item.object_id for item in objects])(incomplete)


def complete_made_object(context: typer.Context, incomplete: str) -> list[str]:
    """Complete the name of an object of the data directory."""
    data = context.params.get("data")
    try:
        return complete(lambda: DataDirectory(data).collection(SURFACES) if data else ())(incomplete)
    except (PipelineError, OSError):
        return []


def complete_setting(incomplete: str) -> list[str]:
    """Complete STAGE.SETTING=VALUE: stages, then a stage's settings, then a setting's values, or its default if any value is allowed.

    A misspelt setting gets no values: the shell keeps what is typed, and a value would hide the mistake.
    """
    before, equals, text = incomplete.partition("=")
    if equals:
        stage, _, name = before.partition(".")
        fields = load_stage(stage).settings_type.model_fields if stage in STAGES else {}
        return [f"{before}={value}" for value in (_values(name, fields[name]) if name in fields else ()) if value.startswith(text)]
    stages = [name for name in STAGES if f"{name}.".startswith(incomplete) or incomplete.startswith(f"{name}.")]
    if len(stages) != 1:
        return [f"{name}." for name in stages]
    (stage,) = stages
    fields = load_stage(stage).settings_type.model_fields
    names = [name for name in fields if f"{stage}.{name}".startswith(incomplete)]
    if len(names) > 1:
        return [f"{stage}.{name}=" for name in names]
    return [f"{stage}.{name}={value}" for name in names for value in _values(name, fields[name])]


def _values(name: str, field: FieldInfo) -> list[str]:
    """List the allowed values of a setting, or its default."""
    if name in ("hand", "sensor", "scene"):
        return list(shipped_files(cast(Kind, name)))
    choices = get_args(field.annotation) if get_origin(field.annotation) is Literal else (field.default,)
    return [value_text(choice) for choice in choices]


DataArgument = Annotated[str, Argument(help="Data directory, or s3://BUCKET/PREFIX.")]
ManifestOption = Annotated[
    str,
    of_objects(help="A built-in manifest, or the path of a YAML file.", is_eager=True, autocompletion=complete_described("manifest")),
]
PresetOption = Annotated[str, of_settings(help=f"One of {', '.join(load_presets())}.", autocompletion=complete(load_presets))]
DataOption = Annotated[
    str | None,
    of_objects(help="Directory or s3://BUCKET/PREFIX; by default data/MANIFEST/PRESET, or data/MANIFEST-OBJECTS/PRESET."),
]
ObjectsOption = Annotated[Path | None, of_objects(help="Folder of meshes, for manifests that name none.", is_eager=True)]
UnitsOption = Annotated[
    Literal["mm", "cm", "dm", "m", "in", "ft"] | None,
    of_objects(help="Unit of the mesh files, to keep real sizes; else as they state, or all of one size. A file's own entry comes first."),
]
UpOption = Annotated[
    Literal["x", "y", "z"] | None,
    of_objects(help="Axis of the mesh files that points up; by default what they state (glTF: y), else z. A file's own entry comes first."),
]
SetOption = Annotated[
    list[str] | None,
    of_settings("--set", help="STAGE.SETTING=VALUE, or SETTING=VALUE for every stage that has it.", autocompletion=complete_setting),
]
SeedOption = Annotated[int | None, of_settings(min=0, help="Root seed, instead of the manifest's.")]
ExecutorName = Literal["processes", "serial"]
ExecutorOption = Annotated[ExecutorName, of_run(help="processes: one per core; serial: this process alone.")]
WorkersOption = Annotated[int, of_run(min=0, help="Worker processes on this machine; 0 for one per core.")]
ShardsOption = Annotated[int | None, of_run(min=1, max=9999, help="Number of shards; by default the dataset's, or 1.")]


def make_executor(name: ExecutorName, workers: int, scheduler: str | None) -> Executor:
    """Make the requested executor, by default with one process per core."""
    if name == "serial":
        if workers or scheduler:
            fail("--executor serial has one process, this one; leave --workers and --scheduler out")
        return Serial()
    if workers and scheduler:
        fail("--scheduler has workers of its own; leave --workers out")
    if scheduler and not scheduler.startswith(("tls://", "wss://", "inproc://")):
        print_warning(
            "warning:",
            f"whoever reaches {scheduler} can run code as you, on its workers and here; where others share the machines or the network, "
            "use tls://HOST:8786 and certificates",
        )
    if scheduler:
        from pipeline.engine.dask_executor import Dask

        return Dask(scheduler)
    return WorkerProcesses(workers)

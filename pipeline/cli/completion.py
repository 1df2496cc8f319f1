"""Complete stages, presets, manifests, description files, settings and objects in a shell."""

from collections.abc import Callable, Iterable
from typing import Literal, cast, get_args, get_origin

import typer
from pydantic.fields import FieldInfo

from pipeline.config.manifest import load_manifest
from pipeline.config.settings import load_presets, value_text
from pipeline.errors import PipelineError
from pipeline.formats.description_file import Kind, shipped_files
from pipeline.plugins import declared
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from stages.registry import STAGES, load_stage


def complete_stage(incomplete: str) -> list[str]:
    """Complete the name of a stage."""
    return _with_prefix(incomplete, STAGES)


def complete_preset(incomplete: str) -> list[str]:
    """Complete the name of a preset."""
    return _with_prefix(incomplete, load_presets())


def complete_described(*kinds: Kind) -> Callable[[str], list[str]]:
    """Make a function that completes the name of a shipped file of these kinds; the shell completes paths."""
    return lambda incomplete: _with_prefix(incomplete, [name for kind in kinds for name in shipped_files(kind)])


def complete_object(context: typer.Context, incomplete: str) -> list[str]:
    """Complete the name of an object of the manifest; nothing if the manifest needs a folder that is not given."""
    try:
        objects = load_manifest(context.params.get("manifest") or "toy").objects(context.params.get("objects"))
    except (PipelineError, OSError):
        return []
    return _with_prefix(incomplete, (item.object_id for item in objects))


def complete_made_object(context: typer.Context, incomplete: str) -> list[str]:
    """Complete the name of an object of the data directory."""
    data = context.params.get("data")
    try:
        return _with_prefix(incomplete, DataDirectory(data).collection(SURFACES) if data else ())
    except (PipelineError, OSError):
        return []


def complete_export(incomplete: str) -> list[str]:
    """Complete the name of an export."""
    return _with_prefix(incomplete, (entry.name for entry in declared("exports")))


def complete_setting(incomplete: str) -> list[str]:
    """Complete STAGE.SETTING=VALUE: stages, then a stage's settings, then a setting's values, or its default if any value is allowed.

    A misspelt setting gets no values: the shell keeps what is typed, and a value would hide the mistake.
    """
    before, equals, text = incomplete.partition("=")
    if equals:
        stage, _, name = before.partition(".")
        fields = load_stage(stage).settings_type.model_fields if stage in STAGES else {}
        return [f"{before}={value}" for value in _with_prefix(text, _values(name, fields[name]) if name in fields else ())]
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


def _with_prefix(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]

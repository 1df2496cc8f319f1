"""Settings: each with its default, its reason, and what it changes.

A setting defines the task (which hand, how many grasps), or changes results (how accurately the task is solved: each has a measured
error), or changes speed alone.
"""

import json
from collections.abc import Mapping
from functools import cache, partial
from importlib import import_module, resources
from typing import Any, ClassVar, Literal

import yaml
from pydantic import AfterValidator, Field

from pipeline.entries import Entries

Change = Literal["definition", "results", "speed"]


class Settings(Entries):
    """Settings. Those of a stage derive from it, each field made by `setting`."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Values of a plugin's stage, by preset; those of other stages are in `pipeline/assets/presets.yaml`."""

    def results(self) -> dict[str, Any]:
        """Return the settings that a result depends on, as plain values: they belong to a stage's key."""
        return {name: value for name, value in self.model_dump(mode="json").items() if self.changes(name) != "speed"}

    @classmethod
    def changes(cls, name: str) -> str:
        """Name what a setting changes."""
        extra = cls.model_fields[name].json_schema_extra
        return str(extra["changes"]) if isinstance(extra, dict) else "results"


def setting(default: Any, reason: str, *, changes: Change = "results", **limits: Any) -> Any:
    """Declare a setting: its default, why that is the default, what it changes, and limits as pydantic's `Field` takes them."""
    return Field(default, description=reason, json_schema_extra={"changes": changes}, **limits)


defining = partial(setting, changes="definition")


def value_text(value: Any) -> str:
    """Write a setting's value as `--set` takes it."""
    return json.dumps(value, ensure_ascii=False, default=str).replace('"', "")


LOADERS = {"hand": ("hand_file", "load_hand"), "sensor": ("sensor_file", "load_sensor"), "scene": ("scene_file", "load_scene")}
"""The function that reads each kind of description file, after its module."""


def described_by(kind: Literal["hand", "sensor", "scene"]) -> AfterValidator:
    """Read the description file that a setting names, so that errors in it are reported before the first stage runs.

    It is imported by name: its code belongs to the keys of the stages that use it, not to those of all.
    """

    def read(name: str) -> str:
        module, function = LOADERS[kind]
        getattr(import_module(f"pipeline.formats.{module}"), function)(name)
        return name

    return AfterValidator(read)


class ObjectSettings(Settings):
    """The settings of every stage over objects."""

    object_seconds: int = setting(
        3600, "a worker that takes longer is ended, the second time its object fails: some meshes never end", ge=1, changes="speed"
    )


@cache
def load_presets() -> dict[str, dict[str, dict[str, Any]]]:
    """Load every preset: values by stage; a setting that it leaves out keeps its default."""
    text = resources.files("pipeline").joinpath("assets/presets.yaml").read_text(encoding="utf-8")
    presets: dict[str, dict[str, dict[str, Any]]] = yaml.safe_load(text)
    return presets

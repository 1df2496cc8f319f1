"""Presets, and what a user sets on top of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from importlib import resources
from typing import Any, Protocol

import yaml
from pydantic import ValidationError

from pipeline.config.complaints import complaints
from pipeline.config.settings import Settings
from pipeline.errors import SettingsError


class HasSettings(Protocol):
    """A stage, as far as its settings go."""

    @property
    def name(self) -> str:
        """Its name, as `--set` gives it."""

    @property
    def settings_type(self) -> type[Settings]:
        """Its settings."""


def load_presets() -> dict[str, dict[str, dict[str, Any]]]:
    """Load every preset: values by stage; a setting that it leaves out keeps its default."""
    text = resources.files("pipeline").joinpath("assets/presets.yaml").read_text()
    presets: dict[str, dict[str, dict[str, Any]]] = yaml.safe_load(text)
    return {name: preset or {} for name, preset in presets.items()}


def _value(assignment: str, text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise SettingsError(f"--set {assignment}: {text!r} is no value: {error}") from error


def resolve(
    stage: HasSettings,
    preset: str,
    assignments: Iterable[str],
    stages: Collection[str],
    known_elsewhere: Callable[[str], bool] = lambda _: True,
) -> Settings:
    """A stage's settings: its defaults, then the preset, then `STAGE.SETTING=VALUE`, or `SETTING=VALUE` for every stage that has it.

    Assignments to other stages are left alone, so that one list serves all of them; `known_elsewhere` tells whether
    another stage has a setting of that name, `STAGE.SETTING` or `SETTING`.

    Raises
    ------
    SettingsError
        Unknown preset, stage or setting, or a value that is not allowed: with what there is.
    """
    presets = load_presets()
    if preset not in presets:
        raise SettingsError(f"there is no preset {preset}; there are {', '.join(presets)}")
    values = dict(presets[preset].get(stage.name, {}))
    for assignment in assignments:
        name, separator, value = assignment.partition("=")
        owner, _, field = name.rpartition(".")
        if not separator or not field:
            raise SettingsError(f"--set {assignment}: write STAGE.SETTING=VALUE")
        if owner and owner not in stages:
            raise SettingsError(f"--set {assignment}: there is no stage {owner}; there are {', '.join(stages)}")
        if owner and owner != stage.name and not known_elsewhere(name):
            raise SettingsError(f"--set {assignment}: {owner} has no setting {field}; `vt-pipeline stages` lists them")
        if owner == stage.name or (not owner and (field in stage.settings_type.model_fields or not known_elsewhere(field))):
            values[field] = _value(assignment, value)
    try:
        return stage.settings_type.model_validate(values)
    except ValidationError as error:
        known = ", ".join(stage.settings_type.model_fields)
        raise SettingsError(f"settings of {stage.name}: {complaints(error)}. Its settings are {known}") from error

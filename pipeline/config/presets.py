"""Presets: named values of settings, by stage."""

from functools import cache
from importlib import resources
from typing import Any

import yaml


@cache
def load_presets() -> dict[str, dict[str, dict[str, Any]]]:
    """Load every preset: values by stage; a setting that it leaves out keeps its default."""
    text = resources.files("pipeline").joinpath("assets/presets.yaml").read_text(encoding="utf-8")
    presets: dict[str, dict[str, dict[str, Any]]] = yaml.safe_load(text)
    return presets

"""Checks of description files, one module per kind: `check(path, picture)` says what is in the file, and draws it."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from pipeline.errors import InvalidInput
from pipeline.formats.description_file import read_yaml, shipped_files

ENTRIES = {
    "sensor": {"w", "rows", "cols"},
    "hand": {"urdf", "palm", "fingers"},
    "scene": {"cameras", "background"},
    "manifest": {"sources", "splits"},
}
"""What tells the kinds of description files apart."""


def check_file(name: str, picture: Path | None) -> list[str]:
    """Check a description file, and draw what it describes.

    Parameters
    ----------
    name
        Path of a file, or the name of a shipped one.
    picture
        PNG to write; by default NAME.png in the current folder.

    Returns
    -------
    What is in the file, line by line.

    Raises
    ------
    InvalidInput
        It is of no known kind, or cannot be used: the message names every such entry.
    """
    shipped = {known: file for kind in ENTRIES for known, file in shipped_files(kind).items()}  # type: ignore[arg-type]
    path = shipped.get(name, Path(name).expanduser())
    if not path.exists():
        raise InvalidInput(f"there is no file {path}; built in are {', '.join(sorted(shipped))}")
    kind = _kind_of(path)
    module = f"{__name__}.{kind}_check"
    if find_spec(module) is None:
        raise InvalidInput(f"{path} is a {kind} file, which cannot be checked yet; `vt-pipeline run --dry-run` reads it")
    lines: list[str] = import_module(module).check(path, picture or Path(f"{path.stem}.png"))
    return lines


def _kind_of(path: Path) -> str:
    try:
        content: Any = read_yaml(path)
    except (ValueError, yaml.YAMLError) as error:
        raise InvalidInput(f"{path} cannot be read as YAML: {error}") from error
    found = {kind: len(entries & set(content)) for kind, entries in ENTRIES.items()} if isinstance(content, dict) else {}
    if not any(found.values()):
        said = "; ".join(f"a {kind} has {', '.join(sorted(entries))}" for kind, entries in ENTRIES.items())
        raise InvalidInput(f"{path} has no entries by which to tell what it describes: {said}")
    return max(found, key=lambda kind: found[kind])

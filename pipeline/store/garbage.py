"""Find and remove what no record names: groups and folders that were replaced, and what killed runs left."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from pipeline.errors import StoreError
from pipeline.store.atomic import TEMPORARY
from pipeline.store.directory import DESCRIPTION, FOLDER_RECORDS, DataDirectory, is_version
from pipeline.store.record import read_content
from schemas.catalogue import ARTIFACTS

GRACE_SECONDS = 3600.0
"""How long a group that was replaced is kept: readers that opened it may still be at work."""


def unnamed(folder: Path) -> Iterator[Path]:
    """Find the groups and folders directly in a folder that none of its records names, and files that were never finished."""
    yield from folder.glob(f"*{TEMPORARY}")
    named = {named_location(path) for path in folder.glob("*.json") if path.name != DESCRIPTION}
    if None in named:  # a damaged record: what it named cannot be told
        return
    yield from (path for path in sorted(folder.glob("*-*")) if path.is_dir() and is_version(path.name) and path.name not in named)


def collect(folder: Path, older_than: float = GRACE_SECONDS) -> list[Path]:
    """Remove what no record of a folder names and was replaced, or written, longer ago, s; returns what was removed."""
    doomed = [path for path in unnamed(folder) if time.time() - path.stat().st_mtime > older_than]
    for path in doomed:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    return doomed


def collect_everything(directory: DataDirectory, older_than: float = GRACE_SECONDS) -> list[Path]:
    """Remove from a data directory all that no record names and was replaced, or written, longer ago, s; returns what was removed."""
    return [path for folder in _folders(directory) for path in collect(folder, older_than)]


def everything_unnamed(directory: DataDirectory) -> list[Path]:
    """Find all in a data directory that no record names."""
    return [path for folder in _folders(directory) for path in unnamed(folder)]


def _folders(directory: DataDirectory) -> list[Path]:
    """The folders that hold records, or held one that was deleted."""
    root = directory.root
    below = (path for pattern in FOLDER_RECORDS if "**" in pattern for path in root.glob(pattern.removesuffix("/*.json")))
    return sorted(
        {root, *(root / name for name in ARTIFACTS), *(one for one in below if not any(map(is_version, one.relative_to(root).parts)))}
    )


def named_location(path: Path) -> str | None:
    """What the record at `path` names; None where there is no record that can be read."""
    try:
        return str(read_content(path)["location"])
    except (StoreError, KeyError):
        return None

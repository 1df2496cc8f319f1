"""Sweeps: a dataset stage over a grid of settings, a folder a point; points that stand are not made again."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from pipeline.store.record import FolderRecord


def points(grid: Mapping[str, Iterable[Any]]) -> Iterator[dict[str, Any]]:
    """Every combination of the grid's values, the last setting's changing fastest."""
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def place(stage: str, folder: str, point: Mapping[str, Any]) -> str:
    """The folder of a point, below the data directory: named by what it varies."""
    name = ",".join(f"{setting}={value}" for setting, value in point.items())
    return f"sweeps/{stage}/{folder.rpartition('/')[2]}/{file_name(name)}"


def file_name(label: str) -> str:
    """A label of settings and values as the name of a folder."""
    return re.sub(r"[^A-Za-z0-9=,._+-]", "_", label)


def show(found: list[tuple[dict[str, Any], FolderRecord]], console: Console) -> None:
    """Print the points, the best first, by the validation loss of their best epoch."""
    ranked = sorted(found, key=lambda entry: entry[1].facts["best"]["loss"])
    table = Table(*ranked[0][0], "best loss", "epoch", "parameters", "training s", box=None, padding=(0, 2))
    for point, record in ranked:
        facts = record.facts
        numbers = (f"{facts['best']['loss']:.4g}", f"{facts['best_epoch'] + 1} of {facts['epochs']}", f"{facts['parameters']:,}")
        table.add_row(*map(str, point.values()), *numbers, f"{facts['training_seconds']:.0f}")
    console.print(table)

"""The evaluation of the single-image network on disk and in print, beside the published rows of Table 4."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError, field_validator
from rich.console import Console
from rich.markup import escape

from pipeline.console import print_table
from pipeline.errors import StoreError
from pipeline.formats.complaints import complaints
from pipeline.store.storage import read_bytes
from stages.evaluate_single_image.table_4 import MEAN, PUBLISHED

METRICS = "metrics.json"
NONE = "–"

Figures = tuple[float | None, float | None, float | None]


class _Measured(BaseModel):
    points: int
    scale: float
    tau: float


class _Printed(BaseModel):
    """What is printed of the file: `rows` hold the Chamfer distance and both F1 by row and class."""

    settings: _Measured
    manifest: str
    objects: int
    views: int
    training_objects: int
    rows: dict[str, dict[str, Figures]]

    @field_validator("rows")
    @classmethod
    def _each_class(cls, rows: dict[str, dict[str, Figures]]) -> dict[str, dict[str, Figures]]:
        kinds = rows.get("network", {}).keys()
        if MEAN not in kinds or any(means.keys() != kinds for means in rows.values()):
            raise ValueError(f"each row needs the same classes and {MEAN}, and one is of the network")
        return rows


def show(folder: Path, console: Console) -> None:
    """Print Table 4 with our rows, and our rows by class; a `StoreError` where the file does not hold them."""
    try:
        said = _Printed.model_validate_json(read_bytes(folder / METRICS)).model_dump()
    except ValidationError as error:
        raise StoreError(f"{folder / METRICS} cannot be used: {complaints(error)}; run evaluate-single-image again") from error
    settings, rows = said["settings"], said["rows"]
    first, second = settings["tau"], 2 * settings["tau"]
    title = (
        f"Table 4: single images; clouds of {settings['points']} points of objects of diagonal {settings['scale']:g}, "
        f"Chamfer distance × 1000, F1 in % at squared distances {first:g} and {second:g}"
    )
    print_table(console, ("", "Chamfer", f"F1 at {first:g}", f"F1 at {second:g}"), _table_4(rows), title)
    console.print(
        f"The first {len(PUBLISHED)} rows are published ones, of ShapeNetCore with 3D-R2N2's renderings. Ours are of the manifest "
        f"{escape(said['manifest'])}: {said['objects']} test objects of {len(rows['network']) - 1} classes, {said['views']} views each, "
        f"learned from {said['training_objects']} objects; they can be compared with the published ones only where the data is the same."
    )
    classes = [name for name in rows["network"] if name != MEAN]
    print_table(console, ("", *map(escape, classes), "mean of classes"), _by_class(rows, classes), "The same by class: Chamfer / F1 / F1")


def _table_4(rows: Mapping[str, Mapping[str, list[float]]]) -> Iterator[list[str]]:
    for name, figures in PUBLISHED.items():
        yield [f"[dim]{cell}[/]" for cell in (name, *_cells(figures))]
    for name, means in rows.items():
        yield [f"ours: {name}", *_cells(means[MEAN])]


def _by_class(rows: Mapping[str, Mapping[str, list[float]]], classes: list[str]) -> Iterator[list[str]]:
    for name, means in rows.items():
        yield [name, *(" / ".join(_cells(means[kind])) for kind in (*classes, MEAN))]


def _cells(figures: Any) -> list[str]:
    return [NONE if figure is None else f"{figure:.{digits}f}" for figure, digits in zip(figures, (3, 2, 2), strict=True)]

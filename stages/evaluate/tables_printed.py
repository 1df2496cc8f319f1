"""An evaluation printed: the supplement's tables, each beside its figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.dataset.touch_statistics import SUPPLEMENT_SUCCESS
from pipeline.kernels.metrics.bootstrap import LEVEL
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from stages.evaluate.store import Arrays, read_root, read_table
from stages.evaluate.supplement import BEST_EPOCH, TABLE_2, TABLE_3

NONE = "–"


def show(folder: Path, console: Console) -> None:
    """Print the tables of an evaluation folder; a `StoreError` where there is none."""
    root = read_root(folder)
    felt = any(what["touch"] for what in root["configurations"].values())
    settings, objects = root["settings"], read_table(folder, "objects")
    floor = objects["floor"].mean()
    console.print(
        f"[bold]evaluation[/] of {len(objects['floor'])} objects, split {root['split']}, seed {root['seed']}; Chamfer distance: mean "
        f"squared nearest distance, both directions summed, n = {settings['points']} points a side, sampling floor "
        f"2A/(πn) = {floor:.3e} m² ({TABLE_3_FACTOR * floor:.3f} in Table 3's unit, × {TABLE_3_FACTOR:.0f}); "
        f"in brackets: {100 * LEVEL:.0f} % bootstrap intervals over objects"
    )
    if root["left_out"]:
        console.print(f"left out, for they failed: {escape(', '.join(root['left_out']))}")
    _dataset(read_table(folder, "table_1"), console)
    _rings(read_table(folder, "table_2"), floor / 2, console)
    if felt:
        _grasps(read_table(folder, "table_3"), floor, console)
    modalities = read_table(folder, "modalities")
    _modalities(modalities, console)
    _f1(modalities, settings["scale"], console)
    if felt:
        _charts(read_table(folder, "charts"), console)


def _table(columns: Iterable[object]) -> Table:
    return Table(*map(str, columns), box=None, padding=(0, 2))


def _print(title: str, table: Table, console: Console) -> None:
    """A table under its title, which may be wider."""
    console.print(f"\n[bold]{title}[/]")
    console.print(table)


def _interval(table: Arrays, name: str, at: tuple[int, int], digits: str, factor: float = 1.0) -> str:
    mean, low, high = (factor * table[key][at] for key in (name, "low", "high"))
    ends = f"\n[dim]({low:{digits}}–{high:{digits}})[/]" if np.isfinite([low, high]).all() else ""
    return f"{mean:{digits}}{ends}"


def _dataset(table: Arrays, console: Console) -> None:
    printed = _table(("class", "objects", "grasps", "touches", "% successful", "supplement"))
    for name, *counts, share in zip(*(table[key] for key in ("category", "objects", "grasps", "touches", "successful")), strict=True):
        theirs = SUPPLEMENT_SUCCESS.get(name)
        printed.add_row(name, *map(str, counts), f"{100 * share:.1f}", NONE if theirs is None else f"{theirs:.1f}")
    _print("Table 1: the dataset, all splits", printed, console)


def _rings(table: Arrays, floor: float, console: Console) -> None:
    title = (
        f"Table 2: local Chamfer distance around the touch sites of one grasp, ground truth to prediction, m²; floor A/(πn) = {floor:.2e}"
    )
    printed = _table(("model", *(f"×{ring}" for ring in table["ring"])))
    for row, name in enumerate(table["configuration"]):
        cells = [
            _interval(table, "local_chamfer", (row, ring), ".2e") if table["objects"][row, ring] else NONE
            for ring in range(len(table["ring"]))
        ]
        printed.add_row(name, *cells)
        _theirs(printed, TABLE_2.get(name), len(cells), ".3e")
    sites = table["sites"][0] if len(table["sites"]) else []
    printed.add_row("[dim]sites[/]", *(f"[dim]{count}[/]" for count in sites))
    _print(title, printed, console)


def _grasps(table: Arrays, floor: float, console: Console) -> None:
    title = f"Table 3: Chamfer distance × {TABLE_3_FACTOR:.0f} by the number of grasps; floor {TABLE_3_FACTOR * floor:.3f}"
    printed = _table(("model", *table["grasps_given"]))
    for row, name in enumerate(table["configuration"]):
        cells = [_interval(table, "chamfer", (row, column), ".3f", TABLE_3_FACTOR) for column in range(len(table["grasps_given"]))]
        printed.add_row(name, *cells)
        _theirs(printed, _at(TABLE_3.get(name), table["grasps_given"]), len(cells), ".3f")
    _print(title, printed, console)


def _at(figures: Sequence[float] | None, given: np.ndarray) -> list[float | None] | None:
    return None if figures is None else [figures[number - 1] if number <= len(figures) else None for number in given]


def _theirs(printed: Table, figures: Sequence[float | None] | None, columns: int, digits: str) -> None:
    """A row with the supplement's figures, where it has some."""
    if figures is not None:
        cells = [NONE if figure is None else f"{figure:{digits}}" for figure in [*figures, *[None] * columns][:columns]]
        printed.add_row("[dim]  supplement[/]", *(f"[dim]{cell}[/]" for cell in cells))


def _modalities(table: Arrays, console: Console) -> None:
    title = f"Modalities: Chamfer distance × {TABLE_3_FACTOR:.0f} with one grasp, by class; the last column in m²"
    printed = _table(("model", *_classes(table), "all, m²"))
    for row, name in enumerate(table["configuration"]):
        cells = [_interval(table, "chamfer", (row, column), ".3f", TABLE_3_FACTOR) for column in range(len(table["category"]))]
        printed.add_row(name, *cells, f"{table['chamfer'][row, -1]:.3e}")
    floors = [f"{TABLE_3_FACTOR * floor:.3f}" for floor in table["floor"]]
    printed.add_row(*(f"[dim]{cell}[/]" for cell in ("sampling floor", *floors, f"{table['floor'][-1]:.3e}")))
    _print(title, printed, console)


def _f1(table: Arrays, scale: float, console: Console) -> None:
    first, second = table["tau"]
    title = f"F1, %, at squared distance τ = {first:g} / 2τ = {second:g} m² of clouds scaled by {scale:g}, with one grasp"
    printed = _table(("model", *_classes(table)))
    for row, name in enumerate(table["configuration"]):
        printed.add_row(name, *(f"{100 * tau:.1f} / {100 * two:.1f}" for tau, two in table["f1"][row]))
    _print(title, printed, console)


def _classes(table: Arrays) -> list[str]:
    return [f"{name} ({count})" for name, count in zip(table["category"], table["objects"], strict=True)]


def _charts(table: Arrays, console: Console) -> None:
    columns = ("stopped by", "charts", "RMS residual, mean, µm", "worst, µm", "iterations")
    printed = _table(columns)
    keys = ("stop_rule", "charts", "residual_mean", "residual_worst", "iterations")
    for name, count, mean, worst, iterations in zip(*(table[key] for key in keys), strict=True):
        printed.add_row(name, str(count), f"{1e6 * mean:.0f}", f"{1e6 * worst:.0f}", f"{iterations:.0f}")
    _print("Touch charts of these objects: distance of the cloud to its chart", printed, console)


def show_training(facts: Mapping[str, Mapping[str, Any]], console: Console) -> None:
    """Print what each model's training took and on what, from the facts of its record, by name."""
    printed = _table(("model", "parameters", "epochs", "best", "supplement's best", "validation loss", "seconds", "hardware"))
    for name, row in facts.items():
        theirs: Any = BEST_EPOCH.get(name, NONE)
        best, ran = row["best_epoch"] + 1, row["hardware"]
        hardware = f"{ran['device']}, {ran['processes']} process(es) of {ran['threads']} threads, {ran['precision']}"
        numbers = (f"{row['parameters']:,}", f"{row['epochs']}", f"{best}", f"{theirs}", f"{row['best']['loss']:.4g}")
        printed.add_row(name, *numbers, f"{row['training_seconds']:.0f}", escape(hardware))
    _print("Training", printed, console)

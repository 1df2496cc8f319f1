"""An evaluation printed: the supplement's tables, each beside its figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from pipeline.console import print_table
from pipeline.dataset.touch_statistics import SUPPLEMENT_SUCCESS
from pipeline.kernels.metrics.bootstrap import LEVEL
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from stages.evaluate.evaluation_files import Arrays, has_table, read_root, read_table
from stages.evaluate.supplement_figures import BEST_EPOCH, TABLE_2, TABLE_3

NONE = "–"

QUALITY_UNITS = {
    "area_ratio": ("area, % of the true one", 100),
    "dihedral": ("dihedral angle, °", 1),
    "seam_gap": ("seams, mm", 1e3),
    "spike": ("99.9 % within, mm", 1e3),
    "normal_consistency": ("normals agree, %", 100),
    "crossing": ("faces that cross, %", 100),
}
"""How a measure is called in print, and the factor to the unit there."""

Rows = Iterator[Sequence[object]]


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
    columns: tuple[object, ...] = ("class", "objects", "grasps", "touches", "% successful", "supplement")
    print_table(console, columns, _dataset(read_table(folder, "table_1")), "Table 1: the dataset, all splits")
    table = read_table(folder, "table_2")
    title = f"local Chamfer distance around the touch sites of one grasp, ground truth to prediction, m²; floor A/(πn) = {floor / 2:.2e}"
    print_table(console, ("model", *(f"×{ring}" for ring in table["ring"])), _rings(table), f"Table 2: {title}")
    if felt:
        table = read_table(folder, "table_3")
        title = f"Chamfer distance × {TABLE_3_FACTOR:.0f} by the number of grasps; floor {TABLE_3_FACTOR * floor:.3f}"
        print_table(console, ("model", *table["grasps_given"]), _grasps(table), f"Table 3: {title}")
    table = read_table(folder, "modalities")
    classes = [f"{escape(name)} ({count})" for name, count in zip(table["category"], table["objects"], strict=True)]
    title = f"Modalities: Chamfer distance × {TABLE_3_FACTOR:.0f} with one grasp, by class; the last column in m²"
    print_table(console, ("model", *classes, "all, m²"), _modalities(table), title)
    first, second = table["tau"]
    title = f"squared distance τ = {first:g} / 2τ = {second:g} m² of clouds scaled by {settings['scale']:g}, with one grasp"
    print_table(console, ("model", *classes), _f1(table), f"F1, %, at {title}")
    if has_table(folder, "baselines"):
        table = read_table(folder, "baselines")
        title = f"Baselines: Chamfer distance × {TABLE_3_FACTOR:.0f} of a training object that is looked up: mean (interval), median"
        print_table(console, ("chosen", *classes), _baselines(table), title)
    table = read_table(folder, "quality")
    title = "Surfaces with one grasp, mean / median over objects"
    print_table(console, ("model", *(label for label, _ in QUALITY_UNITS.values())), _quality(table), title)
    if has_table(folder, "closed_surfaces"):
        columns = ("model", "watertight, %", "objects with an inside", "intersection over union, mean / median")
        print_table(console, columns, _closed(read_table(folder, "closed_surfaces")), "Closed meshes of the surfaces with one grasp")
    if felt:
        columns = ("stopped by", "charts", "RMS residual, mean, µm", "worst, µm", "iterations")
        title = "Touch charts of these objects: distance of the cloud to its chart"
        print_table(console, columns, _charts(read_table(folder, "charts")), title)


def _dataset(table: Arrays) -> Rows:
    for name, *counts, share in zip(*(table[key] for key in ("category", "objects", "grasps", "touches", "successful")), strict=True):
        yield escape(name), *counts, f"{100 * share:.1f}", SUPPLEMENT_SUCCESS.get(name, NONE)


def _rings(table: Arrays) -> Rows:
    for row, name in enumerate(table["configuration"]):
        cells = _intervals(table, "local_chamfer", row, ".2e")
        yield name, *(cell if count else NONE for cell, count in zip(cells, table["objects"][row], strict=True))
        yield from _supplement(TABLE_2.get(name), table["ring"], ".3e")
    yield _dim("sites", *table["sites"][0])


def _grasps(table: Arrays) -> Rows:
    for row, name in enumerate(table["configuration"]):
        yield name, *_intervals(table, "chamfer", row, ".3f", TABLE_3_FACTOR)
        yield from _supplement(TABLE_3.get(name), table["grasps_given"], ".3f")


def _modalities(table: Arrays) -> Rows:
    for row, name in enumerate(table["configuration"]):
        yield name, *_intervals(table, "chamfer", row, ".3f", TABLE_3_FACTOR), f"{table['chamfer'][row, -1]:.3e}"
        yield _dim("  median", *(f"{TABLE_3_FACTOR * median:.3f}" for median in table["median"][row]), NONE)
    yield _dim("sampling floor", *(f"{TABLE_3_FACTOR * floor:.3f}" for floor in table["floor"]), f"{table['floor'][-1]:.3e}")


def _baselines(table: Arrays) -> Rows:
    for row, name in enumerate(table["baseline"]):
        cells = zip(_intervals(table, "chamfer", row, ".3f", TABLE_3_FACTOR), table["median"][row], strict=True)
        yield name, *(f"{cell}\n{TABLE_3_FACTOR * median:.3f}" for cell, median in cells)


def _quality(table: Arrays) -> Rows:
    factors = [QUALITY_UNITS[str(name)][1] for name in table["measure"]]
    for row, name in enumerate(table["configuration"]):
        pairs = zip(factors, table["mean"][row], table["median"][row], strict=True)
        yield name, *(f"{factor * mean:.3g} / {factor * median:.3g}" for factor, mean, median in pairs)


def _closed(table: Arrays) -> Rows:
    for name, watertight, count, mean, median in zip(
        *(table[key] for key in ("configuration", "watertight", "objects", "mean", "median")), strict=True
    ):
        yield name, f"{100 * watertight:.0f}", count, f"{mean:.3f} / {median:.3f}" if count else NONE


def _f1(table: Arrays) -> Rows:
    for row, name in enumerate(table["configuration"]):
        yield name, *(f"{100 * tau:.1f} / {100 * two:.1f}" for tau, two in table["f1"][row])


def _charts(table: Arrays) -> Rows:
    keys = ("stop_rule", "charts", "residual_mean", "residual_worst", "iterations")
    for name, count, mean, worst, iterations in zip(*(table[key] for key in keys), strict=True):
        yield name, count, f"{1e6 * mean:.0f}", f"{1e6 * worst:.0f}", f"{iterations:.0f}"


def _intervals(table: Arrays, name: str, row: int, digits: str, factor: float = 1.0) -> Iterator[str]:
    """Format the means of a row of a table, each with its interval where it has one."""
    for mean, low, high in zip(*(factor * table[key][row] for key in (name, "low", "high")), strict=True):
        yield f"{mean:{digits}}" + (f"\n[dim]({low:{digits}}–{high:{digits}})[/]" if np.isfinite([low, high]).all() else "")


def _supplement(figures: Sequence[float] | None, columns: np.ndarray, digits: str) -> Rows:
    """Make a row with the supplement's figures for the columns 1, 2, …, where it has some."""
    if figures is not None:
        yield _dim("  supplement", *(f"{figures[number - 1]:{digits}}" if number <= len(figures) else NONE for number in columns))


def _dim(*cells: object) -> list[str]:
    return [f"[dim]{cell}[/]" for cell in cells]


def show_training(facts: Mapping[str, Mapping[str, Any]], console: Console) -> None:
    """Print what each model's training took and on what, from the facts of its record, by name."""
    columns = ("model", "parameters", "epochs", "best", "supplement's best", "validation loss", "seconds", "hardware")
    rows: list[Sequence[object]] = []
    for name, row in facts.items():
        ran = row["hardware"]
        hardware = f"{ran['device']}, {ran['processes']} process(es) of {ran['threads']} threads, {ran['precision']}"
        numbers = (f"{row['parameters']:,}", row["epochs"], row["best_epoch"] + 1, BEST_EPOCH.get(name, NONE))
        rows.append((name, *numbers, f"{row['best']['loss']:.4g}", f"{row['training_seconds']:.0f}", escape(hardware)))
    print_table(console, columns, rows, "Training")

"""Sweep a dataset stage over a grid of settings, one folder per point; points that are up to date are not repeated."""

import re
from collections.abc import Mapping
from typing import Any

from pipeline.console import Row, Table
from pipeline.store.digest import of_json
from pipeline.store.record import FolderRecord

LONGEST_NAME = 150  # characters of the name of a point's folder: records allow 200, with those of a version


def point_folder(
    stage: str,  # trains networks of one family
    folder: str,  # the model's outside sweeps, `models[/seed-N][/FAMILY]/NETWORK`
    point: Mapping[str, Any],  # values of the settings that vary
) -> str:
    """Name the folder of a point of a sweep, below the data directory."""
    name = ",".join(f"{setting}={value}" for setting, value in point.items())
    *parents, network = folder.split("/")
    where = "/".join([*(part for part in parents if part.startswith("seed-")), network])
    return f"sweeps/{stage}/{where}/{file_name(name)}"


def file_name(label: str) -> str:
    """Turn a label of settings and values into the name of a folder; a long one ends with a digest of the label."""
    name = re.sub(r"[^A-Za-z0-9=,._+-]", "_", label)
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 17]}-{of_json(label)[:16]}"


def sweep_table(results: list[tuple[dict[str, Any], FolderRecord]]) -> Table:
    """Tabulate the points in order of the validation loss of their best epoch."""
    ranked = sorted(results, key=lambda entry: entry[1].facts["best"]["loss"])
    rows = []
    for point, record in ranked:
        facts = record.facts
        epoch = f"{facts['best_epoch'] + 1} of {facts['epochs']}"
        rows.append(Row([*map(str, point.values()), facts["best"]["loss"], epoch, facts["parameters"], facts["training_seconds"]]))
    settings = list(ranked[0][0])
    columns = [*settings, "best loss", "epoch", "parameters", "training s"]
    return Table("", columns, rows, [*[""] * len(settings), ".4g", "", ",", ".0f"])

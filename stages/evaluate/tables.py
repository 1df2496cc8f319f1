"""The tables of an evaluation, from its figures, beside the supplement's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Cell, Row, Table
from pipeline.dataset.touch_statistics import SUPPLEMENT_SUCCESS
from pipeline.kernels.metrics.bootstrap import LEVEL, Interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.rng import numpy_rng
from stages.evaluate.baselines import LOOKED_UP
from stages.evaluate.evaluation_files import Arrays, Figures, read_figures, read_root, read_table
from stages.evaluate.grasp_protocol import ALL
from stages.evaluate.supplement_figures import BEST_EPOCH, TABLE_2, TABLE_3, TABLE_4

QUALITY_UNITS = {
    "area_ratio": ("area, % of the true one", 100),
    "dihedral": ("dihedral angle, °", 1),
    "seam_gap": ("seams, mm", 1e3),
    "spike": ("99.9 % within, mm", 1e3),
    "normal_consistency": ("normals agree, %", 100),
    "crossing": ("faces that cross, %", 100),
}
"""Labels of the measures of surfaces, and the factors to their units."""

Networks = Mapping[str, Figures]
Members = Mapping[str, NDArray[np.bool_]]


def evaluation_tables(folder: Path) -> list[Table]:
    """Make the tables of an evaluation folder of any protocol; raise a `StoreError` if there is none."""
    return list(_single_image_tables(folder) if "views" in read_root(folder) else _grasp_tables(folder))


def _grasp_tables(folder: Path) -> Iterator[Table]:
    root, figures, objects = read_root(folder), read_figures(folder), read_table(folder, "objects")
    settings, floor = root["settings"], objects["floor"].mean()
    networks = {name: figures[name] for name in root["configurations"]}
    felt = {name: networks[name] for name, given in root["configurations"].items() if given["touch"]}
    members, rng = _members(objects["category"]), partial(numpy_rng, root["seed"])
    classes = [f"{name} ({member.sum()})" for name, member in members.items()]
    yield Table(
        f"evaluation of {len(objects['floor'])} objects, split {root['split']}, seed {root['seed']}; Chamfer distance: mean "
        f"squared nearest distance, both directions summed, n = {settings['points']} points a side, sampling floor "
        f"2A/(πn) = {floor:.3e} m² ({TABLE_3_FACTOR * floor:.3f} in Table 3's unit, × {TABLE_3_FACTOR:.0f}); "
        f"in brackets: {100 * LEVEL:.0f} % bootstrap intervals over objects"
    )
    if root["left_out"]:
        yield Table(f"left out because they failed: {', '.join(root['left_out'])}")
    yield _dataset(read_table(folder, "table_1"))
    yield _rings(networks, settings["rings"], floor, partial(rng, "table_2"))
    if felt:
        yield _grasps(felt, floor, partial(rng, "table_3"))
    yield _modalities(networks, members, classes, objects["floor"], partial(rng, "modalities"))
    tau = settings["tau"]
    title = f"F1, %, at squared distance τ = {tau:g} / 2τ = {2 * tau:g} m² of clouds scaled by {settings['scale']:g}, with one grasp"
    rows = [[name, *_by_class(network, members, ("f1", "f1_2tau"))] for name, network in networks.items()]
    yield Table(title, ["model", *classes], [Row(row) for row in rows], ["", *[".1f"] * len(classes)])
    if looked_up := {name: network for name, network in figures.items() if name.startswith(LOOKED_UP)}:
        yield _baselines(looked_up, members, classes, partial(rng, "baselines"))
    labels = ["model", *(label for label, _ in QUALITY_UNITS.values())]
    yield Table("Surfaces with one grasp, mean / median over objects", labels, _quality(networks), ["", *[".3g"] * len(QUALITY_UNITS)])
    if settings["closed_resolution"]:
        columns = ["model", "watertight, %", "objects with an inside", "intersection over union, mean / median"]
        title = "Closed meshes of the surfaces with one grasp"
        yield Table(title, columns, [_closed(name, network) for name, network in networks.items()], ["", ".0f", "", ".3f"])
    if felt:
        yield _charts(read_table(folder, "charts"))


def _members(categories: Sequence[str] | NDArray[Any]) -> dict[str, NDArray[np.bool_]]:
    """Find which objects are of each class, and of all."""
    names = np.array(categories)
    return {str(name): names == name for name in np.unique(names)} | {ALL: np.full(len(names), True)}


def _estimate(values: NDArray[np.float64], rng: np.random.Generator, factor: float = 1.0) -> Interval | None:
    """Estimate the mean over objects; None without objects."""
    return mean_interval(factor * values, rng) if len(values) else None


def _dataset(table: Arrays) -> Table:
    keys = ("category", "objects", "grasps", "touches", "successful")
    rows = [
        Row([name, *counts, 100 * share, str(SUPPLEMENT_SUCCESS.get(name, "–"))])
        for name, *counts, share in zip(*(table[key].tolist() for key in keys), strict=True)
    ]
    columns = ["class", "objects", "grasps", "touches", "% successful", "supplement"]
    return Table("Table 1: the dataset, all splits", columns, rows, ["", "", "", "", ".1f", ""])


def _supplement(figures: Sequence[float] | None, columns: Sequence[int], digits: str) -> list[Row]:
    """Make a row with the supplement's figures for the columns 1, 2, …, where it has some."""
    if figures is None:
        return []
    return [Row(["  supplement", *(f"{figures[at - 1]:{digits}}" if at <= len(figures) else None for at in columns)], dim=True)]


def _rings(networks: Networks, count: int, floor: float, rng: Callable[..., np.random.Generator]) -> Table:
    numbers, rows = range(1, count + 1), []
    sites: list[int] = []
    for name, figures in networks.items():
        columns = [figures.ring(number) for number in numbers]
        rows.append(Row([name, *(_estimate(means[counts > 0], rng(name, at)) for at, (means, counts) in enumerate(columns))]))
        rows += _supplement(TABLE_2.get(name), numbers, ".3e")
        sites = sites or [int(counts.sum()) for _, counts in columns]
    rows.append(Row(["sites", *map(str, sites)], dim=True))
    title = "Table 2: local Chamfer distance around the touch sites of one grasp, ground truth to prediction, m²; floor A/(πn) = "
    return Table(f"{title}{floor / 2:.2e}", ["model", *(f"×{number}" for number in numbers)], rows, ["", *[".2e"] * count])


def _grasps(networks: Networks, floor: float, rng: Callable[..., np.random.Generator]) -> Table:
    numbers, rows = next(iter(networks.values())).grasps, []
    for name, figures in networks.items():
        estimates = (_estimate(figures.per_object("chamfer", number), rng(name, number), TABLE_3_FACTOR) for number in numbers)
        rows.append(Row([name, *estimates]))
        rows += _supplement(TABLE_3.get(name), numbers, ".3f")
    title = f"Table 3: Chamfer distance × {TABLE_3_FACTOR:.0f} by the number of grasps; floor {TABLE_3_FACTOR * floor:.3f}"
    return Table(title, ["model", *map(str, numbers)], rows, ["", *[".3f"] * len(numbers)])


def _modalities(
    networks: Networks, members: Members, classes: list[str], floor: NDArray[np.float64], rng: Callable[..., np.random.Generator]
) -> Table:
    rows = [row for name, figures in networks.items() for row in _chamfer_rows(name, figures, members, rng, metres=True)]
    floors = [float(floor[member].mean()) for member in members.values()]
    rows.append(Row(["sampling floor", *(TABLE_3_FACTOR * mean for mean in floors), floors[-1]], dim=True))
    title = f"Modalities: Chamfer distance × {TABLE_3_FACTOR:.0f} with one grasp, by class; the last column in m²"
    return Table(title, ["model", *classes, "all, m²"], rows, ["", *[".3f"] * len(classes), ".3e"])


def _baselines(networks: Networks, members: Members, classes: list[str], rng: Callable[..., np.random.Generator]) -> Table:
    named = {name.removeprefix(LOOKED_UP): figures for name, figures in networks.items()}
    rows = [row for name, figures in named.items() for row in _chamfer_rows(name, figures, members, rng)]
    title = f"Baselines: Chamfer distance × {TABLE_3_FACTOR:.0f} of a training object that is looked up"
    return Table(title, ["chosen", *classes], rows, ["", *[".3f"] * len(classes)])


def _chamfer_rows(
    name: str, figures: Figures, members: Members, rng: Callable[..., np.random.Generator], *, metres: bool = False
) -> Iterator[Row]:
    """Make the rows of means and medians by class, in Table 3's unit; `metres` adds the mean over all in m²."""
    values = figures.per_object("chamfer")
    means = [_estimate(values[member], rng(name, kind), TABLE_3_FACTOR) for kind, member in members.items()]
    medians = [TABLE_3_FACTOR * float(np.median(values[member])) for member in members.values()]
    yield Row([name, *means, *([float(values.mean())] if metres else [])])
    yield Row(["  median", *medians, *([None] if metres else [])], dim=True)


def _by_class(figures: Figures, members: Members, metrics: Sequence[str]) -> list[Cell]:
    return [tuple(100 * float(figures.per_object(metric)[member].mean()) for metric in metrics) for member in members.values()]


def _quality(networks: Networks) -> list[Row]:
    rows = []
    for name, figures in networks.items():
        values = [(factor, figures.available(measure)) for measure, (_, factor) in QUALITY_UNITS.items()]
        rows.append(Row([name, *((factor * _mean(measured), factor * _median(measured)) for factor, measured in values)]))
    return rows


def _closed(name: str, figures: Figures) -> Row:
    shared = figures.available("iou")
    return Row([name, 100 * _mean(figures.available("watertight")), len(shared), (_mean(shared), _median(shared)) if len(shared) else None])


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean())


def _median(values: NDArray[np.float64]) -> float:
    return float(np.median(values))


def _charts(table: Arrays) -> Table:
    keys = ("stop_rule", "charts", "residual_mean", "residual_worst", "iterations")
    rows = [
        Row([name, count, 1e6 * mean, 1e6 * worst, iterations])
        for name, count, mean, worst, iterations in zip(*(table[key].tolist() for key in keys), strict=True)
    ]
    columns = ["stopped by", "charts", "RMS residual, mean, µm", "worst, µm", "iterations"]
    return Table("Touch charts of these objects: distance of the cloud to its chart", columns, rows, ["", "", ".0f", ".0f", ".0f"])


def _single_image_tables(folder: Path) -> Iterator[Table]:
    """Make Table 4 with our rows, and our rows by class."""
    root, networks, categories = read_root(folder), read_figures(folder), read_table(folder, "objects")["category"]
    settings, tau = root["settings"], root["settings"]["tau"]
    means = {name: means_by_class(_table_4_figures(figures), categories) for name, figures in networks.items()}
    classes = [name for name in next(iter(means.values())) if name != MEAN]
    rows = [Row([name, *figures], dim=True) for name, figures in TABLE_4.items()]
    rows += [Row([f"ours: {name}", *by_class[MEAN].tolist()]) for name, by_class in means.items()]
    title = (
        f"Table 4: single images; clouds of {settings['points']} points of objects of diagonal {settings['scale']:g}, "
        f"Chamfer distance × 1000, F1 in % at squared distances {tau:g} and {2 * tau:g}"
    )
    yield Table(title, ["", "Chamfer", f"F1 at {tau:g}", f"F1 at {2 * tau:g}"], rows, ["", ".3f", ".2f", ".2f"])
    yield Table(
        f"The first {len(TABLE_4)} rows are published ones, of ShapeNetCore with 3D-R2N2's renderings. Ours are of the manifest "
        f"{root['manifest']}: {len(categories)} test objects of {len(classes)} classes, {root['views']} views each, "
        f"learned from {root['training_objects']} objects; they can be compared with the published ones only where the data is the same."
    )
    rows = []
    for name, by_class in means.items():
        cells = [f"{chamfer:.3f} / {f1:.2f} / {twice:.2f}" for chamfer, f1, twice in (by_class[kind] for kind in (*classes, MEAN))]
        rows.append(Row([name, *cells]))
    yield Table("The same by class: Chamfer / F1 / F1", ["", *classes, "mean of classes"], rows)


MEAN = "mean"
"""Name of the mean over classes."""


def _table_4_figures(figures: Figures) -> NDArray[np.float64]:
    """Join (object, view, figure) in the units of Table 4."""
    return np.stack([figures.per_case("scaled_chamfer"), 100 * figures.per_case("f1"), 100 * figures.per_case("f1_2tau")], axis=-1)


def means_by_class(figures: NDArray[np.float64], categories: Sequence[str] | NDArray[Any]) -> dict[str, NDArray[np.float64]]:
    """Average figures over the views of an object, over the objects of a class, and over classes.

    Parameters
    ----------
    figures
        (object, view, figure).
    categories
        Of the objects.

    Returns
    -------
    (figure,) means by class, and under `mean` the mean over classes: each counts the same, however many objects it has.
    """
    names, per_object = np.array(categories), figures.mean(axis=1)
    means = {str(name): per_object[names == name].mean(axis=0) for name in np.unique(names)}
    return {**means, MEAN: np.mean(list(means.values()), axis=0)}


def training_table(facts: Mapping[str, Mapping[str, Any]]) -> Table:
    """List each model's training: epochs, loss, time and hardware, from the facts of its record, by name."""
    columns = ["model", "parameters", "epochs", "best", "supplement's best", "validation loss", "seconds", "hardware"]
    rows = []
    for name, row in facts.items():
        ran = row["hardware"]
        hardware = f"{ran['device']}, {ran['processes']} process(es) of {ran['threads']} threads, {ran['precision']}"
        epochs = (row["epochs"], row["best_epoch"] + 1, BEST_EPOCH.get(name))
        rows.append(Row([name, row["parameters"], *epochs, row["best"]["loss"], row["training_seconds"], hardware]))
    return Table("Training", columns, rows, ["", ",", "", "", "", ".4g", ".0f", ""])

"""The tables of an evaluation, from its figures, beside the supplement's."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Cell, Row, Table, pluralise
from pipeline.dataset.touch_statistics import PAPER, PAPER_DIAGONAL, SUPPLEMENT_SUCCESS
from pipeline.kernels.metrics.bootstrap import LEVEL, Interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR, sampling_distance, sampling_share
from pipeline.rng import numpy_rng
from pipeline.tables.comparison import about_grasps, about_shipped, comparable_figures, left_out
from pipeline.tables.single_image_tables import single_image_tables
from pipeline.tables.supplement_figures import TABLE_2, TABLE_3
from stages.evaluate.baselines import BASELINE_PREFIX, label
from stages.evaluate.evaluation_files import Arrays, Figures, has_table, read_root, read_table
from stages.evaluate.grasp_protocol import ALL, NEAR, NEAR_SHARE

QUALITY_UNITS = {
    "area_ratio": ("area, % of the true one", 100),
    "dihedral": ("dihedral angle, °", 1),
    "seam_gap": ("seams, mm", 1e3),
    "spike": ("99.9 % within, mm", 1e3),
    "normal_consistency": ("normals agree, %", 100),
    "crossing": ("faces that cross, %", 100),
}
"""Labels of the measures of surfaces, and the factors to their units."""

ACCURACY = {
    "mean distance, mm": ("mean_distance", 1e3),
    f"F-score at {1e3 * NEAR:g} mm, %": ("f_5mm", 100),
    f"F-score at {100 * NEAR_SHARE:g} % of the diagonal, %": ("f_1percent", 100),
}
"""The metrics that need no explanation, by label, and the factors to their units."""

SHARED = {"normals agree, %": ("normal_consistency", 100), "intersection over union": ("iou", 1)}
"""Further metrics that only surfaces have (of the first grasp), and only closed ones."""

CHAMFER = ("chamfer", TABLE_3_FACTOR)
"""In Table 3's unit."""

Networks = Mapping[str, Figures]
Members = Mapping[str, NDArray[np.bool_]]
SAMPLING_ALONE = "what sampling alone gives"
"""Label of the Chamfer distance between two samplings of one surface, on average."""


def evaluation_tables(folder: Path, scored: Sequence[Path] = ()) -> list[Table]:
    """Make the tables of an evaluation folder of any protocol.

    Scores of other methods get rows beside the networks'.
    """
    return list(single_image_tables(folder) if "views" in read_root(folder) else _grasp_tables(folder, scored))


def _grasp_tables(folder: Path, scored: Sequence[Path]) -> Iterator[Table]:
    root, objects = read_root(folder), read_table(folder, "objects")
    settings, paper, floor = root["settings"], root["paper_sizes"], objects["floor"].mean()
    inputs_by_name, figures, common = comparable_figures(folder, scored)
    yield from left_out(folder, scored)
    every = {name: figures[name] for name in inputs_by_name}
    networks = {name: network for name, network in every.items() if 1 in network.grasps}
    touch_networks = {name: every[name] for name, inputs in inputs_by_name.items() if inputs["touch"]}
    baselines = {name: network for name, network in figures.items() if name.startswith(BASELINE_PREFIX)}
    members, seed = _members(objects["category"]), root["seed"]
    classes = [f"{name} ({member.sum()})" for name, member in members.items()]
    yield Table(
        f"Evaluation of {pluralise(len(objects['floor']))}, split {root['split']}, seed {root['seed']}; {settings['points']} points drawn "
        f"from each surface. In brackets: {100 * LEVEL:.0f} % bootstrap intervals over objects."
    )
    if root["left_out"]:
        yield Table(f"Left out because they failed: {', '.join(root['left_out'])}")
    yield from about_grasps(common)
    yield from about_shipped([folder, *scored])
    yield _accuracy({**every, **baselines}, objects, settings["points"], seed)
    if len(_numbers(touch_networks)) > 1:
        yield _distances_by_grasps(touch_networks, seed)
    if networks:
        yield _distances_by_class(networks, members, classes, seed)
    yield _dataset(read_table(folder, "table_1"), paper)
    yield Table(_about_chamfer(objects["diagonal"], paper))
    if networks:
        yield _rings(networks, settings["rings"], floor, seed, paper)
    if touch_networks:
        yield _grasps(touch_networks, floor, seed, paper)
    if networks:
        yield _modalities(networks, members, classes, objects["floor"], seed)
        if paper:
            yield _f1(networks, members, classes, settings["tau"], settings["scale"])
    if baselines:
        yield _baselines(baselines, root["training_objects"], members, classes, seed)
    if networks:
        yield from _surfaces(networks, settings["closed_resolution"], scored=bool(scored))
    if has_table(folder, "charts"):
        yield _charts(read_table(folder, "charts"))


def _numbers(networks: Networks) -> list[int]:
    """List the numbers of grasps with which any of these networks was measured."""
    return sorted({number for figures in networks.values() for number in figures.grasps})


def _accuracy(networks: Networks, objects: Arrays, points: int, seed: int) -> Table:
    """Make the table of the simplest figures with one grasp, or the fewest with which a network was measured.

    Baselines and the limit of sampling are below the networks.
    """
    rows = []
    for name, figures in networks.items():
        fewest = figures.grasps[0]
        distances = [(figures.per_object(metric, fewest), factor) for metric, factor in (*ACCURACY.values(), CHAMFER)]
        shared = [(_shared(figures, metric, fewest), factor) for metric, factor in SHARED.values()]
        cells = [_estimate(values, seed, factor) for values, factor in (*distances, *shared)]
        row_label = label(name) if fewest == 1 else f"{name}, {fewest} grasps"
        rows.append(Row([row_label, *cells], dim=name.startswith(BASELINE_PREFIX)))
    best = [
        (1e3 * sampling_distance(area, points), *(100 * sampling_share(area, points, limit) for limit in (NEAR, NEAR_SHARE * diagonal)))
        for area, diagonal in zip(objects["area"].tolist(), objects["diagonal"].tolist(), strict=True)
    ]
    floor = TABLE_3_FACTOR * float(objects["floor"].mean())
    rows.append(Row(["best value that sampling allows", *np.mean(best, axis=0).tolist(), floor, None, None], dim=True))
    columns = ["model", *ACCURACY, f"Chamfer × {TABLE_3_FACTOR:.0f}, m²", *SHARED]
    with_inside = max(len(_shared(figures, "iou", figures.grasps[0])) for figures in networks.values())
    some = f"; intersection over union: of {with_inside} that have an inside" if 0 < with_inside < len(objects["area"]) else ""
    return Table(f"Accuracy with one grasp{some}", columns, rows, ["", ".2f", ".1f", ".1f", ".3f", ".1f", ".3f"])


def _shared(figures: Figures, metric: str, grasps: int) -> NDArray[np.float64]:  # (object,)
    """Take a metric of surfaces; the overlap of insides only of networks that close some of theirs."""
    closes = metric != "iou" or figures.available("watertight", grasps).any()
    return figures.available(metric, grasps) if closes else np.zeros(0)


def _distances_by_grasps(networks: Networks, seed: int) -> Table:
    numbers = _numbers(networks)
    rows = [
        Row([name, *(_estimate(figures.per_object("mean_distance", number), seed, 1e3) for number in numbers)])
        for name, figures in networks.items()
    ]
    return Table("Mean distance, mm, by the number of grasps given", ["model", *map(str, numbers)], rows, ["", *[".2f"] * len(numbers)])


def _distances_by_class(networks: Networks, members: Members, classes: list[str], seed: int) -> Table:
    rows = []
    for name, figures in networks.items():
        values = figures.per_object("mean_distance")
        rows.append(Row([name, *(_estimate(values[member], seed, 1e3) for member in members.values())]))
    return Table("Mean distance, mm, with one grasp, by class", ["model", *classes], rows, ["", *[".2f"] * len(classes)])


def _about_chamfer(diagonals: NDArray[np.float64], paper: bool) -> str:
    """Explain the Chamfer distances of the tables that follow, and why the paper's figures are beside them or not."""
    text = (
        "Chamfer distance: mean squared nearest distance, both directions summed, in m² or × "
        f"{TABLE_3_FACTOR:.0f}, the unit of Table 3 of {PAPER}. It grows with the square of an object's size."
    )
    if paper:
        return f"{text} The figures of {PAPER} are of other objects, scaled to {PAPER_DIAGONAL:g} m as these are."
    sizes = " to ".join(dict.fromkeys(f"{1e3 * size:.0f}" for size in (diagonals.min(), diagonals.max())))
    return (
        f"{text} The diagonals of these objects are {sizes} mm; {PAPER} scaled its objects to {1e3 * PAPER_DIAGONAL:.0f} mm, so its "
        "figures cannot be compared with these and are left out."
    )


def _members(categories: Sequence[str] | NDArray[Any]) -> dict[str, NDArray[np.bool_]]:
    """Find which objects, (object,), are of each class, and of all."""
    names = np.array(categories)
    return {str(name): names == name for name in np.unique(names)} | {ALL: np.full(len(names), True)}


def _estimate(
    values: NDArray[np.float64],  # (object,)
    seed: int,
    factor: float = 1.0,
) -> Interval | None:
    """Estimate the mean over objects; None without objects. Intervals of as many objects share their draws."""
    return mean_interval(factor * values, numpy_rng(seed, "intervals")) if len(values) else None


def _dataset(table: Arrays, paper: bool) -> Table:
    keys = ("category", "objects", "grasps", "touches", "successful")
    rows = [
        Row([name, *counts, 100 * share, *([SUPPLEMENT_SUCCESS.get(name)] if paper else [])])
        for name, *counts, share in zip(*(table[key].tolist() for key in keys), strict=True)
    ]
    columns = ["class", "objects", "grasps", "touches", "% successful", *([f"% in {PAPER}"] if paper else [])]
    return Table("Table 1: the dataset, all splits", columns, rows, ["", "", "", "", ".1f", ".1f"][: len(columns)])


def _theirs(figures: Sequence[float] | None, columns: Sequence[int], digits: str) -> list[Row]:
    """Make a row with the paper's figures, if it has some, for the columns 1, 2, …."""
    if figures is None:
        return []
    return [Row([f"  {PAPER}", *(f"{figures[at - 1]:{digits}}" if at <= len(figures) else None for at in columns)], dim=True)]


def _rings(networks: Networks, count: int, floor: float, seed: int, paper: bool) -> Table:
    numbers, rows = range(1, count + 1), []
    sites: list[str] = []
    for name, figures in networks.items():
        columns = [figures.ring(number) for number in numbers]
        rows.append(Row([name, *(_estimate(means[counts > 0], seed) for means, counts in columns)]))
        rows += _theirs(TABLE_2.get(name) if paper else None, numbers, ".3e")
        sites = sites or [f"{counts.sum()}" for _, counts in columns]
    rows.append(Row([f"sites of {next(iter(networks))}", *sites], dim=True))
    rows.append(Row([SAMPLING_ALONE, *[floor / 2] * count], dim=True))
    title = (
        "Table 2: local Chamfer distance around the touch sites of one grasp, true surface to prediction, m²; "
        "ring ×k: between squares of k - 1 and k sensor widths"
    )
    return Table(title, ["model", *(f"×{number}" for number in numbers)], rows, ["", *[".2e"] * count])


def _grasps(networks: Networks, floor: float, seed: int, paper: bool) -> Table:
    numbers, rows = _numbers(networks), []
    for name, figures in networks.items():
        estimates = (_estimate(figures.per_object("chamfer", number), seed, TABLE_3_FACTOR) for number in numbers)
        rows.append(Row([name, *estimates]))
        rows += _theirs(TABLE_3.get(name) if paper else None, numbers, ".3f")
    rows.append(Row([SAMPLING_ALONE, *[TABLE_3_FACTOR * floor] * len(numbers)], dim=True))
    title = f"Table 3: Chamfer distance × {TABLE_3_FACTOR:.0f}, m², by the number of grasps"
    return Table(title, ["model", *map(str, numbers)], rows, ["", *[".3f"] * len(numbers)])


def _modalities(networks: Networks, members: Members, classes: list[str], floor: NDArray[np.float64], seed: int) -> Table:
    rows = [row for name, figures in networks.items() for row in _chamfer_rows(name, figures, members, seed, metres=True)]
    floors = [float(floor[member].mean()) for member in members.values()]
    rows.append(Row([SAMPLING_ALONE, *(TABLE_3_FACTOR * mean for mean in floors), floors[-1]], dim=True))
    title = f"Modalities: Chamfer distance × {TABLE_3_FACTOR:.0f}, m², with one grasp, by class; the last column without the factor"
    return Table(title, ["model", *classes, "all, m²"], rows, ["", *[".3f"] * len(classes), ".3e"])


def _baselines(networks: Networks, training_objects: int, members: Members, classes: list[str], seed: int) -> Table:
    rows = [row for name, figures in networks.items() for row in _chamfer_rows(label(name), figures, members, seed)]
    chosen = f"one of {pluralise(training_objects, 'training object')}"
    title = f"Baselines: Chamfer distance × {TABLE_3_FACTOR:.0f}, m², of {chosen} in place of each reconstruction"
    return Table(title, ["chosen", *classes], rows, ["", *[".3f"] * len(classes)])


def _chamfer_rows(name: str, figures: Figures, members: Members, seed: int, *, metres: bool = False) -> Iterator[Row]:
    """Make the rows of means and medians by class, in Table 3's unit; `metres` adds the mean over all in m²."""
    values = figures.per_object("chamfer")
    means = [_estimate(values[member], seed, TABLE_3_FACTOR) for member in members.values()]
    medians = [TABLE_3_FACTOR * float(np.median(values[member])) for member in members.values()]
    yield Row([name, *means, *([float(values.mean())] if metres else [])])
    yield Row(["  median", *medians, *([None] if metres else [])], dim=True)


def _f1(networks: Networks, members: Members, classes: list[str], tau: float, scale: float) -> Table:
    title = f"F1, %, at squared distance τ = {tau:g} / 2τ = {2 * tau:g} m² of clouds scaled by {scale:g}, with one grasp"
    rows = [Row([name, *_by_class(network, members, ("f1", "f1_2tau"))]) for name, network in networks.items()]
    return Table(title, ["model", *classes], rows, ["", *[".1f"] * len(classes)])


def _by_class(figures: Figures, members: Members, metrics: Sequence[str]) -> list[Cell]:
    return [tuple(100 * float(figures.per_object(metric)[member].mean()) for metric in metrics) for member in members.values()]


def _surfaces(networks: Networks, resolution: int | None, *, scored: bool) -> Iterator[Table]:
    labels = ["model", *(label for label, _ in QUALITY_UNITS.values())]
    yield Table("Surfaces with one grasp, mean / median over objects", labels, _quality(networks), ["", *[".3g"] * len(QUALITY_UNITS)])
    if closed := {name: network for name, network in networks.items() if len(network.available("watertight"))}:
        columns = ["model", "watertight, %", "objects with an inside", "intersection over union with them, mean / median"]
        method = f"closed with {resolution} edges along their longest side" + (", scored ones as they are" if scored else "")
        title = f"Closed surfaces with one grasp, {method if resolution else 'as they are'}"
        yield Table(title, columns, [_closed(name, network) for name, network in closed.items()], ["", ".0f", "", ".3f"])


def _quality(networks: Networks) -> list[Row]:
    rows = []
    for name, figures in networks.items():
        values = [(factor, figures.available(measure)) for measure, (_, factor) in QUALITY_UNITS.items()]
        cells = ((factor * figure.mean(), factor * np.median(figure)) if len(figure) else None for factor, figure in values)
        rows.append(Row([name, *cells]))
    return rows


def _closed(name: str, figures: Figures) -> Row:
    shared = figures.available("iou")
    mean_and_median = (shared.mean(), np.median(shared)) if len(shared) else None
    return Row([name, 100 * figures.available("watertight").mean(), len(shared), mean_and_median])


def _charts(table: Arrays) -> Table:
    keys = ("stop_rule", "charts", "residual_mean", "residual_worst", "iterations")
    rows = [
        Row([name, count, 1e6 * mean, 1e6 * worst, iterations])
        for name, count, mean, worst, iterations in zip(*(table[key].tolist() for key in keys), strict=True)
    ]
    columns = ["stopped by", "charts", "RMS residual, mean, µm", "worst, µm", "iterations"]
    return Table("Touch charts of these objects: distance of the cloud to its chart", columns, rows, ["", "", ".0f", ".0f", ".0f"])

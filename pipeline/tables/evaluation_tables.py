"""The tables of an evaluation, from its figures, beside the supplement's."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.manifest import TOTAL
from pipeline.console import Cell, Columns, Row, Table, pluralise, tabulate
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL
from pipeline.kernels.metrics.bootstrap import LEVEL, Interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR, sampling_distance, sampling_share
from pipeline.rng import numpy_rng
from pipeline.tables.comparison import about_rows, comparable_figures
from pipeline.tables.part_tables import part_tables
from pipeline.tables.supplement_figures import PAPER, TABLE_2, TABLE_3, TABLE_4
from stages.evaluate.baselines import BASELINE_PREFIX, label
from stages.evaluate.evaluation_files import Arrays, Figures, has_table, read_figures, read_root, read_table
from stages.evaluate.protocols import NEAR, NEAR_SHARE

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
CHAMFER = ("chamfer", TABLE_3_FACTOR)  # in Table 3's unit
SAMPLING_ALONE = "what sampling alone gives"  # label of the Chamfer distance between two samplings of one surface, on average

Networks = Mapping[str, Figures]


def evaluation_tables(folder: Path, scored: Sequence[Path] = ()) -> list[Table]:
    """Make the tables of an evaluation folder of any protocol, with rows of the scores of other methods."""
    return list(single_image_tables(folder) if "views" in read_root(folder) else GraspTables(folder, scored).tables())


class GraspTables:
    """The tables of an evaluation of reconstructions from grasps, and of the scores beside it."""

    def __init__(self, folder: Path, scored: Sequence[Path]) -> None:
        self.folder, self.scored, self.root, self.objects = folder, scored, read_root(folder), read_table(folder, "objects")
        self.settings, self.paper, self.seed = (self.root[name] for name in ("settings", "paper_sizes", "seed"))
        inputs, figures, self.common = comparable_figures(folder, scored)
        self.every: Networks = {name: figures[name] for name in inputs}
        self.networks = {name: network for name, network in self.every.items() if 1 in network.grasps}
        self.touch_networks = {name: self.every[name] for name in inputs if inputs[name]["touch"]}
        self.baselines = {name: network for name, network in figures.items() if name.startswith(BASELINE_PREFIX)}
        categories = np.array(self.objects["category"])
        members = {str(name): categories == name for name in np.unique(categories)} | {TOTAL: np.full(len(categories), True)}
        self.members = {f"{name} ({member.sum()})": member for name, member in members.items()}  # by class and its number of objects
        self.numbers = sorted({number for figures in self.touch_networks.values() for number in figures.grasps})

    def tables(self) -> Iterator[Table]:
        """Yield the tables, and lines of text between them."""
        yield Table(
            f"Evaluation of {pluralise(len(self.objects['floor']))}, split {self.root['split']}, seed {self.seed}; "
            f"{self.settings['points']} points drawn from each surface. In brackets: {100 * LEVEL:.0f} % bootstrap intervals over objects."
        )
        yield from about_rows(self.folder, self.scored, self.common)
        if self.root["failed"]:
            yield Table(f"Failed: {', '.join(self.root['failed'])}")
        yield self._accuracy()
        if not self.paper:
            yield from part_tables(self.every, self.touch_networks, self.baselines, self.seed)
        if len(self.numbers) > 1:
            by_number: Columns = {str(number): (".2f", partial(self._distance, number, slice(None))) for number in self.numbers}
            yield tabulate("Mean distance, mm, by the number of grasps given", "model", self.touch_networks, by_number)
        if self.networks:
            by_class: Columns = {name: (".2f", partial(self._distance, 1, member)) for name, member in self.members.items()}
            yield tabulate("Mean distance, mm, with one grasp, by class", "model", self.networks, by_class)
        yield Table(self._about_chamfer())
        if self.networks:
            yield self._rings()
        if self.touch_networks:
            yield self._grasps()
        if self.networks:
            yield self._modalities()
            if self.paper:
                yield self._f1()
        if self.baselines:
            yield self._baselines()
        if self.networks:
            yield from self._surfaces()
        if has_table(self.folder, "charts"):
            yield _charts(read_table(self.folder, "charts"))

    def _estimate(self, values: Array, factor: float = 1.0) -> Interval | None:
        """Estimate the mean over objects; None without objects. Intervals of as many objects share their draws."""
        return mean_interval(factor * values, numpy_rng(self.seed, "intervals")) if len(values) else None

    def _distance(self, grasps: int, member: Any, figures: Figures) -> Interval | None:
        return self._estimate(figures.per_object("mean_distance", grasps)[member], 1e3)

    def _accuracy(self) -> Table:
        """Make the table of the simplest figures with one grasp, or the fewest with which a network was measured.

        Baselines and the limit of sampling are below the networks.
        """
        rows, networks, points = [], {**self.every, **self.baselines}, self.settings["points"]
        for name, figures in networks.items():
            fewest = figures.grasps[0]
            cells = [self._estimate(figures.per_object(metric, fewest), factor) for metric, factor in (*ACCURACY.values(), CHAMFER)]
            cells += [self._estimate(_shared(figures, metric, fewest), factor) for metric, factor in SHARED.values()]
            rows.append(Row([label(name) if fewest == 1 else f"{name}, {fewest} grasps", *cells], dim=name.startswith(BASELINE_PREFIX)))
        best = [
            (1e3 * sampling_distance(area, points), *(100 * sampling_share(area, points, limit) for limit in (NEAR, NEAR_SHARE * diagonal)))
            for area, diagonal in zip(self.objects["area"].tolist(), self.objects["diagonal"].tolist(), strict=True)
        ]
        floor = TABLE_3_FACTOR * float(self.objects["floor"].mean())
        rows.append(Row(["best value that sampling allows", *np.mean(best, axis=0).tolist(), floor, None, None], dim=True))
        columns = ["model", *ACCURACY, f"Chamfer × {TABLE_3_FACTOR:.0f}, m²", *SHARED]
        with_inside = max(len(_shared(figures, "iou", figures.grasps[0])) for figures in networks.values())
        some = f"; intersection over union: of {with_inside} that have an inside" if 0 < with_inside < len(self.objects["area"]) else ""
        return Table(f"Accuracy with one grasp{some}", columns, rows, ["", ".2f", ".1f", ".1f", ".3f", ".1f", ".3f"])

    def _about_chamfer(self) -> str:
        """Explain the Chamfer distances of the tables that follow, and why the paper's figures are beside them or not."""
        text = (
            "Chamfer distance: mean squared nearest distance, both directions summed, in m² or × "
            f"{TABLE_3_FACTOR:.0f}, the unit of Table 3 of {PAPER}. It grows with the square of an object's size."
        )
        if self.paper:
            return f"{text} The figures of {PAPER} are of other objects, scaled to {DIAGONAL:g} m as these are."
        diagonals = self.objects["diagonal"]
        sizes = " to ".join(dict.fromkeys(f"{1e3 * size:.0f}" for size in (diagonals.min(), diagonals.max())))
        return (
            f"{text} The diagonals of these objects are {sizes} mm; {PAPER} scaled its objects to {1e3 * DIAGONAL:.0f} mm, so its "
            "figures cannot be compared with these and are not shown."
        )

    def _rows(
        self,
        networks: Networks,
        columns: Sequence[int],
        cell: Callable[[Figures, int], Cell],
        paper: Mapping[str, Sequence[float]],
        digits: str,
    ) -> list[Row]:
        """Make a row per network, and below it one with the paper's figures, if it has some, of the columns 1, 2, …."""
        rows = []
        for name, figures in networks.items():
            rows.append(Row([name, *(cell(figures, at) for at in columns)]))
            if self.paper and name in paper:
                theirs = (f"{paper[name][at - 1]:{digits}}" if at <= len(paper[name]) else None for at in columns)
                rows.append(Row([f"  {PAPER}", *theirs], dim=True))
        return rows

    def _rings(self) -> Table:
        def mean(figures: Figures, number: int) -> Interval | None:
            means, counts = figures.ring(number)
            return self._estimate(means[counts > 0])

        numbers = range(1, self.settings["rings"] + 1)
        first, figures = next(iter(self.networks.items()))
        rows = self._rows(self.networks, numbers, mean, TABLE_2, ".3e")
        rows.append(Row([f"sites of {first}", *(f"{figures.ring(number)[1].sum()}" for number in numbers)], dim=True))
        rows.append(Row([SAMPLING_ALONE, *[self.objects["floor"].mean() / 2] * len(numbers)], dim=True))
        title = (
            "Table 2: local Chamfer distance around the touch sites of one grasp, true surface to prediction, m²; "
            "ring ×k: between squares of k - 1 and k sensor widths"
        )
        return Table(title, ["model", *(f"×{number}" for number in numbers)], rows, ["", *[".2e"] * len(numbers)])

    def _grasps(self) -> Table:
        def mean(figures: Figures, number: int) -> Interval | None:
            return self._estimate(figures.per_object("chamfer", number), TABLE_3_FACTOR)

        rows = self._rows(self.touch_networks, self.numbers, mean, TABLE_3, ".3f")
        rows.append(Row([SAMPLING_ALONE, *[TABLE_3_FACTOR * self.objects["floor"].mean()] * len(self.numbers)], dim=True))
        title = f"Table 3: Chamfer distance × {TABLE_3_FACTOR:.0f}, m², by the number of grasps"
        return Table(title, ["model", *map(str, self.numbers)], rows, ["", *[".3f"] * len(self.numbers)])

    def _modalities(self) -> Table:
        rows = [row for name, figures in self.networks.items() for row in self._chamfer_rows(name, figures, metres=True)]
        floors = [float(self.objects["floor"][member].mean()) for member in self.members.values()]
        rows.append(Row([SAMPLING_ALONE, *(TABLE_3_FACTOR * mean for mean in floors), floors[-1]], dim=True))
        title = f"Modalities: Chamfer distance × {TABLE_3_FACTOR:.0f}, m², with one grasp, by class; the last column without the factor"
        return Table(title, ["model", *self.members, "all, m²"], rows, ["", *[".3f"] * len(self.members), ".3e"])

    def _baselines(self) -> Table:
        rows = [row for name, figures in self.baselines.items() for row in self._chamfer_rows(label(name), figures)]
        chosen = f"one of {pluralise(self.root['training_objects'], 'training object')}"
        title = f"Baselines: Chamfer distance × {TABLE_3_FACTOR:.0f}, m², of {chosen} in place of each reconstruction"
        return Table(title, ["chosen", *self.members], rows, ["", *[".3f"] * len(self.members)])

    def _chamfer_rows(self, name: str, figures: Figures, *, metres: bool = False) -> Iterator[Row]:
        """Make the rows of means and medians by class, in Table 3's unit; `metres` adds the mean over all in m²."""
        values = figures.per_object("chamfer")
        means = [self._estimate(values[member], TABLE_3_FACTOR) for member in self.members.values()]
        medians = [TABLE_3_FACTOR * float(np.median(values[member])) for member in self.members.values()]
        yield Row([name, *means, *([float(values.mean())] if metres else [])])
        yield Row(["  median", *medians, *([None] if metres else [])], dim=True)

    def _f1(self) -> Table:
        tau, scale = self.settings["tau"], self.settings["scale"]
        title = f"F1, %, at squared distance τ = {tau:g} / 2τ = {2 * tau:g} m² of clouds scaled by {scale:g}, with one grasp"
        return tabulate(title, "model", self.networks, {name: (".1f", partial(_f1_of, member)) for name, member in self.members.items()})

    def _surfaces(self) -> Iterator[Table]:
        qualities: Columns = {title: (".3g", partial(_quality, measure, factor)) for measure, (title, factor) in QUALITY_UNITS.items()}
        yield tabulate("Surfaces with one grasp, mean / median over objects", "model", self.networks, qualities)
        if closed := {name: network for name, network in self.networks.items() if len(network.available("watertight"))}:
            columns: Columns = {
                "watertight, %": (".0f", lambda figures: 100 * figures.available("watertight").mean()),
                "objects with an inside": ("", lambda figures: len(figures.available("iou"))),
                "intersection over union with them, mean / median": (".3f", partial(_quality, "iou", 1)),
            }
            resolution = self.settings["closed_resolution"]
            method = f"closed with {resolution} edges along their longest side" + (", scored ones as they are" if self.scored else "")
            yield tabulate(f"Closed surfaces with one grasp, {method if resolution else 'as they are'}", "model", closed, columns)


def _shared(figures: Figures, metric: str, grasps: int) -> Array:  # (object,)
    """Take a metric of surfaces; the overlap of insides only of networks that close some of theirs."""
    closes = metric != "iou" or figures.available("watertight", grasps).any()
    return figures.available(metric, grasps) if closes else np.zeros(0)


def _f1_of(member: NDArray[np.bool_], figures: Figures) -> Cell:
    return tuple(100 * float(figures.per_object(metric)[member].mean()) for metric in ("f1", "f1_2tau"))


def _quality(measure: str, factor: float, figures: Figures) -> Cell:
    """Give mean and median of a measure of surfaces; None where no surface has it."""
    values = factor * figures.available(measure)
    return (float(values.mean()), float(np.median(values))) if len(values) else None


def _charts(table: Arrays) -> Table:
    rules = {str(rule): number for number, rule in enumerate(table["stop_rule"])}
    columns: Columns = {
        "charts": ("", lambda number: int(table["charts"][number])),
        "RMS residual, mean, µm": (".0f", lambda number: 1e6 * float(table["residual_mean"][number])),
        "worst, µm": (".0f", lambda number: 1e6 * float(table["residual_worst"][number])),
        "iterations": (".0f", lambda number: float(table["iterations"][number])),
    }
    return tabulate("Touch charts of these objects: distance of the cloud to its chart", "stopped by", rules, columns)


def single_image_tables(folder: Path) -> Iterator[Table]:
    """Make Table 4 with our rows, and our rows by class."""
    root, networks, categories = read_root(folder), read_figures(folder), read_table(folder, "objects")["category"]
    settings, tau = root["settings"], root["settings"]["tau"]
    units = {"scaled_chamfer": 1, "f1": 100, "f1_2tau": 100}
    means = {
        name: means_by_class(np.stack([factor * figures.per_case(metric) for metric, factor in units.items()], axis=-1), categories)
        for name, figures in networks.items()
    }
    classes = [name for name in next(iter(means.values())) if name != TOTAL]
    rows = [Row([name, *figures], dim=True) for name, figures in TABLE_4.items()]
    rows += [Row([f"ours: {label(name)}", *by_class[TOTAL].tolist()]) for name, by_class in means.items()]
    title = (
        f"Table 4: single images; clouds of {settings['points']} points of objects of diagonal {settings['scale']:g}, "
        f"Chamfer distance × 1000, F1 in % at squared distances {tau:g} and {2 * tau:g}"
    )
    yield Table(title, ["", "Chamfer", f"F1 at {tau:g}", f"F1 at {2 * tau:g}"], rows, ["", ".3f", ".2f", ".2f"])
    yield Table(
        f"The first {len(TABLE_4)} rows are published ones, of ShapeNetCore with 3D-R2N2's renderings. Ours are of the manifest "
        f"{root['manifest']}: {pluralise(len(categories), 'test object')} of {pluralise(len(classes), 'class')}, "
        f"{pluralise(root['views'], 'view')} each, "
        f"learned from {pluralise(root['training_objects'])}; they can be compared with the published ones only where the data is the same."
    )
    rows = []
    for name, by_class in means.items():
        cells = [f"{chamfer:.3f} / {f1:.2f} / {twice:.2f}" for chamfer, f1, twice in (by_class[kind] for kind in (*classes, TOTAL))]
        rows.append(Row([label(name), *cells]))
    yield Table("The same by class: Chamfer / F1 / F1", ["", *classes, "mean of classes"], rows)


def means_by_class(
    figures: NDArray[np.float64],  # (object, view, figure)
    categories: Sequence[str] | NDArray[Any],  # (object,)
) -> dict[str, NDArray[np.float64]]:  # (figure,) by class, and under `TOTAL`
    """Average figures over the views of an object, over the objects of a class, and over classes.

    In the mean over classes each counts the same, however many objects it has.
    """
    names, per_object = np.array(categories), figures.mean(axis=1)
    means = {str(name): per_object[names == name].mean(axis=0) for name in np.unique(names)}
    return {**means, TOTAL: np.mean(list(means.values()), axis=0)}

"""Table 4 with the rows of an evaluation of single images, and these rows by class."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.manifest import TOTAL
from pipeline.console import Row, Table, pluralise
from pipeline.tables.supplement_figures import TABLE_4
from stages.evaluate.baselines import label
from stages.evaluate.evaluation_files import Figures, read_figures, read_root, read_table

MEAN = TOTAL
"""Name of the mean over classes: no class has it."""


def single_image_tables(folder: Path) -> Iterator[Table]:
    """Make Table 4 with our rows, and our rows by class."""
    root, networks, categories = read_root(folder), read_figures(folder), read_table(folder, "objects")["category"]
    settings, tau = root["settings"], root["settings"]["tau"]
    means = {name: means_by_class(_table_4_figures(figures), categories) for name, figures in networks.items()}
    classes = [name for name in next(iter(means.values())) if name != MEAN]
    rows = [Row([name, *figures], dim=True) for name, figures in TABLE_4.items()]
    rows += [Row([f"ours: {label(name)}", *by_class[MEAN].tolist()]) for name, by_class in means.items()]
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
        cells = [f"{chamfer:.3f} / {f1:.2f} / {twice:.2f}" for chamfer, f1, twice in (by_class[kind] for kind in (*classes, MEAN))]
        rows.append(Row([label(name), *cells]))
    yield Table("The same by class: Chamfer / F1 / F1", ["", *classes, "mean of classes"], rows)


def _table_4_figures(figures: Figures) -> NDArray[np.float64]:  # (object, view, figure)
    """Join the figures in the units of Table 4."""
    return np.stack([figures.per_case("scaled_chamfer"), 100 * figures.per_case("f1"), 100 * figures.per_case("f1_2tau")], axis=-1)


def means_by_class(
    figures: NDArray[np.float64],  # (object, view, figure)
    categories: Sequence[str] | NDArray[Any],  # (object,)
) -> dict[str, NDArray[np.float64]]:  # (figure,) by class, and under `MEAN`
    """Average figures over the views of an object, over the objects of a class, and over classes.

    In the mean over classes each counts the same, however many objects it has.
    """
    names, per_object = np.array(categories), figures.mean(axis=1)
    means = {str(name): per_object[names == name].mean(axis=0) for name in np.unique(names)}
    return {**means, MEAN: np.mean(list(means.values()), axis=0)}

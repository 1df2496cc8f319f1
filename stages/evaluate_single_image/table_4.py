"""Table 4's standard: three figures per reconstruction, their means per class and over classes, and the published rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.metrics.cloud_distances import CloudDistances

CHAMFER_FACTOR = 1000.0
"""Of Table 4's Chamfer distances."""

FIGURES = ("chamfer", "f1", "f1_twice")
"""Chamfer distance × `CHAMFER_FACTOR` in the scaled unit, and F1 in % at the squared distances tau and 2 tau."""

PUBLISHED: dict[str, tuple[float | None, float | None, float | None]] = {
    "N3MR": (2.629, 33.80, 47.72),  # the supplement prints an F1 of 3.80
    "3D-R2N2": (1.445, 39.01, 54.62),
    "PSG": (0.593, 48.58, 69.78),
    "MVD": (None, 66.39, None),
    "GEOMetrics": (None, 67.37, None),
    "Pixel2Mesh": (0.463, 67.89, 79.88),
    "Mesh R-CNN (pretty)": (0.391, 69.83, 81.76),
    "Mesh R-CNN (best)": (0.306, 74.84, 85.75),
    "the supplement's charts": (0.369, 69.52, 82.33),
}
"""Table 4: the figures of `FIGURES`, None where it has none."""


def figures_of(apart: CloudDistances, *, scale: float, tau: float) -> tuple[float, float, float]:
    """Compute the figures of one reconstruction.

    Parameters
    ----------
    apart
        Squared distances between predicted and true points, m².
    scale
        What both clouds are multiplied by to be in the standard's unit.
    tau
        Squared distance of F1, in that unit.

    Returns
    -------
    The figures of `FIGURES`.
    """
    chamfer = CHAMFER_FACTOR * scale**2 * apart.chamfer
    return chamfer, 100 * apart.f1(tau, scale), 100 * apart.f1(2 * tau, scale)


def means_by_class(figures: NDArray[np.float64], categories: Sequence[str]) -> dict[str, NDArray[np.float64]]:
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
    found = {str(name): per_object[names == name].mean(axis=0) for name in np.unique(names)}
    return {**found, MEAN: np.mean(list(found.values()), axis=0)}


MEAN = "mean"
"""Stands for all classes."""

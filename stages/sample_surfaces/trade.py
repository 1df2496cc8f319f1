"""The trade-off of `sample-surfaces`: the density of points on the surface against time."""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pipeline.dataset.paired_rows import paired_rows
from pipeline.engine.trade import Trade


def coverage(data: Path, reference: Path) -> dict[str, float]:
    """Measure the distance of the reference's points from the nearest points: RMS by object, mm.

    The reference's first points are skipped, if as many remain: with the same random numbers, they lie in the same triangles as these.
    """
    errors = {}
    for name, (points,), (dense,) in paired_rows(data, reference, "points"):
        tested = dense[len(points) :] if len(dense) >= 2 * len(points) else dense
        errors[name] = 1e3 * float(np.sqrt(np.square(cKDTree(points).query(tested)[0]).mean()))
    return errors


TRADE = Trade(
    metric="distance from the surface to the nearest point, RMS",
    unit="mm",
    candidates=({"points": 2500}, {"points": 5000}, {"points": 20_000}, {"directions": 64}),
    errors=coverage,
    reference={"points": 40_000},
)

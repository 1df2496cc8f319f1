"""Tables of what touch adds to an image: errors near the touch and on the hidden side, by number of grasps, and paired differences."""

from collections.abc import Iterator, Mapping

import numpy as np

from pipeline.console import Cell, Row, Table
from pipeline.kernels.metrics.bootstrap import difference_interval, mean_interval
from pipeline.rng import numpy_rng
from stages.evaluate.baselines import label
from stages.evaluate.evaluation_files import Figures
from stages.evaluate.surface_parts import LABELS, REACH

DISTANCES = {"whole": "mean_distance", **{text: f"{part}_distance" for part, text in LABELS.items()}}
SHARES = {"F-score at 2 mm, %": "f_2mm", "F-score at 5 mm, %": "f_5mm"}
"""Metrics by label."""


def part_tables(
    networks: Mapping[str, Figures],
    touch_networks: Mapping[str, Figures],  # those that take touches
    baselines: Mapping[str, Figures],
    seed: int,
) -> Iterator[Table]:
    """Make the tables of an evaluation of objects that were not all scaled to one size."""

    def estimate(figures: Figures, grasps: int, metric: str, factor: float) -> Cell:
        values = figures.by_object(metric, grasps)
        return mean_interval(factor * values[np.isfinite(values)], numpy_rng(seed, "intervals")) if np.isfinite(values).any() else None

    rows = []
    for name, figures in {**networks, **baselines}.items():
        for grasps in figures.grasps:
            given = grasps if name in touch_networks else 0 if name in networks else None
            whole, *parts = (estimate(figures, grasps, metric, 1e3) for metric in DISTANCES.values())
            median = 1e3 * float(np.nanmedian(figures.by_object("mean_distance", grasps)))
            shares = [estimate(figures, grasps, metric, 100) for metric in SHARES.values()]
            rows.append(Row([label(name), given, whole, median, *parts, *shares], dim=name in baselines))
    part_names = [f"{text}, mm" for text in LABELS.values()]
    columns = ["model", "grasps", "mean distance, mm", "median", *part_names, *SHARES]
    formats = ["", "", *[".2f"] * (2 + len(part_names)), *[".1f"] * len(SHARES)]
    yield Table("What touch adds: distances, and F-scores, by the number of grasps given", columns, rows, formats)
    yield Table(
        f"Near the touch: mean distance of true points within {1e3 * REACH:g} mm of what the first grasp touched; hidden: of those that "
        "the camera does not see in the image with that grasp's hand. The mean distance of the whole is of both directions."
    )
    rows = [
        Row([text, *(_difference(metric, first, second, seed) for metric in DISTANCES.values())])
        for text, first, second in _pairs(networks, touch_networks)
    ]
    if rows:
        title = "Differences of distances, mm, object by object, with intervals, and in % of the second: below 0 the first is nearer"
        yield Table(title, ["", *DISTANCES], rows)


Measured = tuple[Figures, int]  # of a network with a number of grasps


def _pairs(networks: Mapping[str, Figures], touch_networks: Mapping[str, Figures]) -> Iterator[tuple[str, Measured, Measured]]:
    """Pair each network that takes touches with the same inputs without them, and the most grasps with one."""
    for name, figures in touch_networks.items():
        without, numbers = name.removesuffix("-touch"), figures.grasps
        if without != name and without in networks and 1 in numbers:
            yield f"{name} − {without}", (figures, 1), (networks[without], 1)
        if 1 in numbers and numbers[-1] > 1:
            yield f"{name}: {numbers[-1]} grasps − 1", (figures, numbers[-1]), (figures, 1)


def _difference(metric: str, first: Measured, second: Measured, seed: int) -> str | None:
    """Write the mean difference over the objects that both have; None without any."""
    ours, theirs = (1e3 * figures.by_object(metric, grasps) for figures, grasps in (first, second))
    both = np.isfinite(ours) & np.isfinite(theirs)
    if not both.any():
        return None
    interval = difference_interval(ours[both], theirs[both], numpy_rng(seed, "intervals"))
    return f"{interval.signed('.2f')}, {100 * interval.mean / theirs[both].mean():+.0f} %"

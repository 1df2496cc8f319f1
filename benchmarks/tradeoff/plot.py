"""Plot a study: error over cost, with the front as a line and the presets named."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.tradeoff.measurements import Measurement, Study

STYLE = {"preset": ("s", 36), "setting": ("o", 12), "combination": ("^", 16), "seed": ("x", 16)}
"""Marker and size by kind."""
AXES = {"seconds": "seconds", "kilobytes": "kB per object"}


def draw(study: Study, path: Path) -> None:
    """Write a PNG with one panel per cost; errors of zero are drawn at a tenth of the least other."""
    least = min((one.error for one in study.measurements if one.error > 0), default=1.0) / 10
    with matplotlib.rc_context({"font.size": 8}):
        figure = Figure((4.6 * len(study.costs), 3.4), dpi=110, layout="constrained")
        for number, cost in enumerate(study.costs):
            _panel(figure.add_subplot(1, len(study.costs), number + 1), study, cost, least)
        figure.savefig(path)


def _panel(axes: Axes, study: Study, cost: str, least: float) -> None:
    def points(measurements: Sequence[Measurement]) -> tuple[list[float], list[float]]:
        return [getattr(one, cost) for one in measurements], [max(one.error, least) for one in measurements]

    for kind, (marker, size) in STYLE.items():
        if chosen := [one for one in study.measurements if one.kind == kind]:
            axes.scatter(*points(chosen), size, marker=marker, label=kind)
    axes.plot(*points(sorted(study.front(), key=lambda one: float(getattr(one, cost)))), color="black", linewidth=0.6)
    for one in study.measurements:
        if one.kind == "preset":
            axes.annotate(one.label, (getattr(one, cost), max(one.error, least)), xytext=(4, 4), textcoords="offset points")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(AXES[cost])
    axes.set_ylabel(study.metric)
    axes.legend(frameon=False)

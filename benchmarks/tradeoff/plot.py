"""A study as a picture: error over cost, the front drawn through, presets named."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.tuning.tradeoff import Trade

STYLE = {"preset": ("s", 36), "setting": ("o", 12), "together": ("^", 16), "seed": ("x", 16)}
"""Marker and size by kind."""
AXES = {"seconds": "seconds", "kilobytes": "kB an object"}


def draw(trade: Trade, path: Path) -> None:
    """Write a PNG, a panel for each cost; errors of zero are drawn at a tenth of the least other."""
    positive = [point.error for point in trade.points if point.error > 0]
    floor = min(positive, default=1.0) / 10
    with matplotlib.rc_context({"font.size": 8}):
        figure = Figure((4.6 * len(trade.costs), 3.4), dpi=110, layout="constrained")
        for place, cost in enumerate(trade.costs):
            _panel(figure.add_subplot(1, len(trade.costs), place + 1), trade, cost, floor)
        figure.savefig(path)


def _panel(axes: Axes, trade: Trade, cost: str, floor: float) -> None:
    for kind, (marker, size) in STYLE.items():
        points = [point for point in trade.points if point.kind == kind]
        if points:
            axes.scatter(
                [getattr(point, cost) for point in points], [max(point.error, floor) for point in points], size, marker=marker, label=kind
            )
    front = sorted(trade.front(), key=lambda point: float(getattr(point, cost)))
    axes.plot([getattr(point, cost) for point in front], [max(point.error, floor) for point in front], color="black", linewidth=0.6)
    for point in trade.points:
        if point.kind == "preset":
            axes.annotate(point.label, (getattr(point, cost), max(point.error, floor)), xytext=(4, 4), textcoords="offset points")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(AXES[cost])
    axes.set_ylabel(trade.metric)
    axes.legend(frameon=False)

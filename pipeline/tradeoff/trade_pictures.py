"""Draw and tabulate measured trades: error over cost."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import BboxBase

from pipeline.console import Row, Table, pluralise
from pipeline.drawing.plots import INK, themed_svg
from pipeline.tradeoff.trades import Choice, MeasuredTrade, Point, Workload

BLUE, RED = "#4477aa", "#cc3311"
LABEL_OFFSETS = ((True, 3), (True, -9), (False, 3), (False, -9), (True, 10), (True, -17))
"""Where a label is, in order of preference: whether to the right of its point, and how far upwards, points."""


def draw_trade(trade: MeasuredTrade, path: Path, used: Point | None = None) -> None:
    """Draw error over seconds per object, logarithmic, as an SVG, with the point `used` marked.

    The front is a line, presets are labelled; an error of 0 is drawn at half the least other one, and labelled so.
    """
    with themed_svg(path, size=(5.6, 3.4), font_size=8) as figure:
        axes = figure.subplots()
        floor = min((point.error for point in trade.points if point.error > 0), default=1.0)
        places = {point.label: (point.seconds, point.error or floor / 2) for point in trade.points}  # there is no 0 on a logarithmic axis
        axes.plot(*zip(*(places[point.label] for point in trade.front()), strict=True), "-", color=BLUE, zorder=1)
        for point in trade.points:
            ends = np.abs(np.array([[point.interval.low], [point.interval.high]]) - point.error)
            color, shape, size = (RED, "s", 6) if used is not None and point.label == used.label else (BLUE, "o", 4)
            axes.errorbar(*places[point.label], np.where(np.isfinite(ends), ends, 0), fmt=shape, color=color, ms=size, lw=0.8)
        _scale(axes, *map(list, zip(*places.values(), strict=True)))
        unit = f", {trade.unit}" if trade.unit else ""
        axes.set(xlabel=trade.cost, ylabel=f"error{unit}")
        axes.set_title(f"{trade.stage}: {trade.metric}", loc="left", fontsize=8)
        axes.margins(0.25, 0.15)
        figure.draw_without_rendering()  # lays the axes out, for the size of the labels
        _label(axes, {point.label + ("" if point.error else ": 0"): places[point.label] for point in trade.points})


def _label(axes: Axes, points: Mapping[str, tuple[float, float]]) -> None:
    """Write each point's label beside it, where it covers no other label if possible."""
    boxes: list[BboxBase] = []
    for text, point in sorted(points.items(), key=lambda entry: entry[1]):
        for right, up in LABEL_OFFSETS:
            place: Any = {"xytext": (5 if right else -5, up), "textcoords": "offset points", "ha": "left" if right else "right"}
            label = axes.annotate(text, point, fontsize=7, color=INK, **place)
            if (right, up) == LABEL_OFFSETS[-1] or not any(label.get_window_extent().overlaps(box) for box in boxes):
                break
            label.remove()
        boxes.append(label.get_window_extent())


def _scale(axes: Axes, *values: list[float]) -> None:
    """Make an axis logarithmic where its values are positive and differ by a third or more."""
    for name, axis, along in zip(("x", "y"), (axes.xaxis, axes.yaxis), values, strict=True):
        if along and min(along) > 0 and max(along) > 1.3 * min(along):
            getattr(axes, f"set_{name}scale")("log")
            axis.set_major_locator(LogLocator(subs=(1, 2, 5) if max(along) > 10 * min(along) else (1, 1.5, 2, 3, 5, 7)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
            axis.set_minor_formatter(NullFormatter())


def trade_table(trade: MeasuredTrade) -> Table:
    """Tabulate the points, the fastest first; * marks those that no other beats, and the user's settings are marked."""
    best, user_point = {point.label for point in trade.front()}, trade.own()
    rows = []
    for point in sorted(trade.points, key=lambda point: (point.seconds, point.error)):
        marks = "*" * (point.label in best) + (" used" if user_point is not None and point.label == user_point.label else "")
        rows.append(Row([point.label, point.seconds, point.kilobytes, point.interval, marks]))
    unit = f", {trade.unit}" if trade.unit else ""
    count = pluralise(len(trade.objects)) + (f", {trade.trained} to learn from" if trade.trained else "")
    title = f"{trade.stage}: {trade.metric}{unit}; {count}, {trade.machine}"
    return Table(title, ["settings", trade.cost, "kB", "error", ""], rows, ["", ".3g", ".3g", ".3g", ""])


def choice_table(choices: Sequence[Choice], workload: Workload) -> Table:
    """Tabulate chosen settings with their times, sizes and errors for a workload."""
    rows = []
    for choice in choices:
        point, trade = choice.point, choice.trade
        megabytes = point.kilobytes * (1 if trade.trained else workload.objects) / 1e3
        unit = f"{trade.unit} {trade.metric}".strip()
        rows.append(Row([trade.stage, point.label, choice.seconds, megabytes, point.error, choice.bound, unit]))
    return Table("", ["stage", "settings", "s", "MB", "error", "at most", ""], rows, ["", "", ".3g", ".3g", ".3g", ".3g", ""])

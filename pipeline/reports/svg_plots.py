"""Static SVG plots that follow a page's light or dark theme."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from pipeline.reports.contact_sheet_page import COLORS
from pipeline.reports.picture_row import save_figure

INK = "#010203"
"""Colour of text and lines while a plot is drawn; the file says in its place what the theme asks for."""

THEME = "<style>svg{--ink:#1b1f24}@media (prefers-color-scheme:dark){svg{--ink:#e8eaed}}</style>"
HATCHES = ("", "//")
"""Told apart without colours."""


@contextmanager
def svg_theme(path: Path) -> Iterator[None]:
    """Draw with the theme's ink and without background; at the end the SVG at `path` is made to follow the theme."""
    inks = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    style: Any = dict.fromkeys(inks, INK) | {
        "font.size": 9,
        "svg.fonttype": "none",
        "svg.hashsalt": path.stem,
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "savefig.facecolor": "none",
        "axes.spines.top": False,
        "axes.spines.right": False,
    }
    with matplotlib.rc_context(style):
        yield
    drawn = path.read_text().replace(INK, "var(--ink)")
    end_of_tag = drawn.index(">", drawn.index("<svg")) + 1
    path.write_text(drawn[:end_of_tag] + THEME + drawn[end_of_tag:])


def draw_bars(path: Path, bars: Mapping[str, ArrayLike], labels: Sequence[object], *, x: str, y: str) -> None:
    """Draw bars in groups, one series per entry of `bars`, as an SVG."""
    with svg_theme(path):
        figure = Figure((4.6, 2.8), layout="constrained")
        axes, width = figure.subplots(), 0.8 / len(bars)
        for number, (name, values) in enumerate(bars.items()):
            places = np.arange(len(labels)) + (number - (len(bars) - 1) / 2) * width
            axes.bar(places, values, width, label=name, color=_color(number), hatch=HATCHES[number % 2], edgecolor=INK, linewidth=0.6)
        axes.set(xlabel=x, ylabel=y, xticks=range(len(labels)), xticklabels=labels)
        axes.legend(frameon=False)
        save_figure(figure, path, metadata={"Date": None})


def draw_histogram(path: Path, values: Mapping[str, NDArray[np.floating]], *, x: str, y: str) -> None:
    """Draw the distribution of each entry of `values` as a line over common bins, as an SVG."""
    with svg_theme(path):
        figure = Figure((4.6, 2.8), layout="constrained")
        axes = figure.subplots()
        highest = max((float(np.max(one, initial=0)) for one in values.values()), default=0.0) or 1.0
        bins = np.linspace(0, highest, 25)
        for number, (name, one) in enumerate(values.items()):
            shares = 100 * np.histogram(one, bins)[0] / max(len(one), 1)
            axes.stairs(shares, bins, label=name, color=_color(number), linewidth=1.6, linestyle=("-", "--", "-.", ":")[number % 4])
        axes.set(xlabel=x, ylabel=y)
        axes.legend(frameon=False)
        save_figure(figure, path, metadata={"Date": None})


def _color(number: int) -> tuple[float, ...]:
    return tuple(channel / 255 for channel in COLORS[number % len(COLORS)])

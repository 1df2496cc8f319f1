"""Write figures of matplotlib as SVG or PNG files, perhaps with the theme of a page."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.text import Text

from pipeline.console import visible
from pipeline.errors import InvalidInput
from pipeline.store.atomic import write_atomically

INK = "#010203"
"""Placeholder for the colour of text and lines, which follows the page's theme."""
THEME = "<style>svg{--ink:#1b1f24}@media (prefers-color-scheme:dark){svg{--ink:#e8eaed}}</style>"


def save_figure(figure: Figure, path: Path, **options: Any) -> None:
    """Write a figure atomically in the format of the suffix, with literal texts: a `$` does not begin a formula."""
    supported = figure.canvas.get_supported_filetypes()
    if path.suffix[1:] not in supported:
        raise InvalidInput(f"{path}: the suffix {path.suffix or '(none)'} names no picture format; use {', '.join(supported)}")
    for text in figure.findobj(Text):
        if text.get_text():  # not the labels of ticks, which are written when the figure is drawn
            text.set_text(visible(text.get_text()))
            text.set_parse_math(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix[1:], **options)
    write_atomically(path, buffer.getvalue())


@contextmanager
def themed_svg(path: Path, size: tuple[float, float] = (4.6, 2.8), font_size: int = 9) -> Iterator[Figure]:
    """Open a figure, and write it at the end as an SVG that follows the page's light or dark theme.

    Width and height are in inches, the font size in points.
    """
    inks = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    style: Any = dict.fromkeys(inks, INK) | {
        "font.size": font_size,
        "svg.fonttype": "none",
        "svg.hashsalt": path.stem,
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "savefig.facecolor": "none",
        "axes.spines.top": False,
        "axes.spines.right": False,
    }
    with matplotlib.rc_context(style):
        figure = Figure(size, layout="constrained")
        yield figure
        save_figure(figure, path, metadata={"Date": None})
    svg = path.read_text(encoding="utf-8").replace(INK, "var(--ink)")
    end_of_tag = svg.index(">", svg.index("<svg")) + 1
    path.write_text(svg[:end_of_tag] + THEME + svg[end_of_tag:], encoding="utf-8")

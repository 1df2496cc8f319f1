"""Figures as files, and a row of titled pictures as one small file."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from pipeline.console import visible
from pipeline.errors import InvalidInput
from pipeline.store.atomic import write_at_once

Panel = NDArray[np.uint8] | Callable[[Any], None]
"""An image (rows, cols, 3), or what draws into axes."""

INCHES, HEAD, DPI = 2.0, 0.25, 110
"""A panel's side, the height of a line of titles, and pixels per inch."""
LOSSY = {".png": {"optimize": True}, ".webp": {"quality": 80, "method": 6}}
"""How files are compressed, by their ending."""


def save_figure(figure: Figure, path: Path, **options: Any) -> None:
    """Write a figure at once, in the format of the suffix; names in it are shown as they are: a `$` begins no formula.

    Raises
    ------
    InvalidInput
        No figure can be written in that format.
    """
    known = figure.canvas.get_supported_filetypes()
    if path.suffix[1:] not in known:
        raise InvalidInput(
            f"{path}: a picture is written as {', '.join(known)}, by suffix; {path.suffix or 'no suffix'} is not one of them"
        )
    for text in figure.findobj(Text):
        if text.get_text():  # not the labels of ticks, which are written when the figure is drawn
            text.set_text(visible(text.get_text()))
            text.set_parse_math(False)
    written = io.BytesIO()
    figure.savefig(written, format=path.suffix[1:], **options)
    write_at_once(path, written.getvalue())


def draw_row(panels: Sequence[tuple[str, Panel]], path: Path, columns: int | None = None, projection: str | None = None) -> None:
    """Draw titled panels in a row, or in rows of `columns`, into a PNG or WebP file; `projection="3d"` gives 3D axes."""
    columns = columns or len(panels)
    rows = -(-len(panels) // columns)
    figure = Figure((INCHES * columns, (INCHES + HEAD) * rows), dpi=DPI, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": projection})
    for axes, (title, panel) in zip(grid.flat, panels, strict=True):
        axes.set_title(title, fontsize=9)
        if callable(panel):
            panel(axes)
        else:
            axes.imshow(panel)
            axes.set_axis_off()
    save_figure(figure, path, pil_kwargs=LOSSY[path.suffix])

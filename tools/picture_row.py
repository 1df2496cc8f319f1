"""Draw a row of titled pictures as one small file, for the documents."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.drawing.plots import save_figure

Panel = NDArray[np.uint8] | Callable[[Any], None]
"""An image (rows, cols, 3), or a function that draws into axes."""
INCHES, HEAD, DPI = 2.0, 0.25, 110
"""A panel's side, the height of a line of titles, and pixels per inch."""
COMPRESSION = {".png": {"optimize": True}, ".webp": {"quality": 80, "method": 6}}
"""Options of Pillow, by the ending of a file."""


def draw_row(
    panels: Sequence[tuple[str, Panel]], path: Path, columns: int | None = None, projection: str | None = None, inches: float = INCHES
) -> None:
    """Draw titled images, or what functions draw into axes, in a row or in rows of `columns`, as a PNG or WebP file."""
    columns = columns or len(panels)
    rows = -(-len(panels) // columns)
    lines = 1 + max(title.count("\n") for title, _ in panels)
    figure = Figure((inches * columns, (inches + HEAD * lines) * rows), dpi=DPI, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": projection})
    for axes, (title, panel) in zip(grid.flat, panels, strict=True):
        axes.set_title(title, fontsize=9)
        if callable(panel):
            panel(axes)
        else:
            axes.imshow(panel)
            axes.set_anchor("N")  # titles of a row are level
            axes.set_axis_off()
    save_figure(figure, path, pil_kwargs=COMPRESSION[path.suffix])

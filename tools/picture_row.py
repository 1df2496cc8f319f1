"""A row of titled pictures as one small file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

Panel = NDArray[np.uint8] | Callable[[Any], None]
"""An image (rows, cols, 3), or what draws into axes."""

INCHES, HEAD, DPI = 2.0, 0.25, 110
"""A panel's side, the height of a line of titles, and pixels per inch."""
LOSSY = {".png": {"optimize": True}, ".webp": {"quality": 80, "method": 6}}
"""How files are compressed, by their ending."""


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
    figure.savefig(path, pil_kwargs=LOSSY[path.suffix])

"""A picture of a calibration: photographs, what the model makes of the same contacts, and the difference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.kernels.touch.calibration_fit import RING, Photograph
from pipeline.reports.picture_row import save_figure

SHOWN = 3
"""Photographs of the picture, spread evenly."""
GAIN = 4
"""By which differences are enlarged."""


def draw_calibration(photographs: Sequence[Photograph], models: Sequence[NDArray[np.uint8]], path: Path) -> None:
    """Draw a row per photograph: the photograph, the model, and their difference × `GAIN` around grey, as a PNG.

    Parameters
    ----------
    photographs, models
        As many; images (rows, cols, 3) uint8.
    path
        The PNG.
    """
    chosen = np.unique(np.linspace(0, len(photographs) - 1, min(SHOWN, len(photographs))).astype(int))
    figure = Figure((9, 3 * len(chosen)), dpi=72, layout="constrained")
    panels = figure.subplots(len(chosen), 3, squeeze=False)
    for row, number in zip(panels, chosen, strict=True):
        one, model = photographs[number], models[number]
        difference = np.clip(128 + GAIN * (model.astype(int) - one.image), 0, 255).astype(np.uint8)
        part = _around(one)
        shown = {f"photograph {one.name}": one.image, "model": model, f"model - photograph, × {GAIN}": difference}
        for axes, (title, image) in zip(row, shown.items(), strict=True):
            axes.imshow(image[part])
            axes.set(xticks=[], yticks=[])
            axes.set_title(title, fontsize=9)
    save_figure(figure, path)


def _around(photograph: Photograph) -> tuple[slice, slice]:
    """The part of an image that the ring around its contact takes up."""
    contact, reach = photograph.contact, RING * photograph.contact.radius
    row, col = (slice(max(0, int(at - reach)), int(at + reach) + 1) for at in (contact.y, contact.x))
    return row, col

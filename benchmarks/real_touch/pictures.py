"""Draw depth as read, the truth and the difference, without photographs."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.real_touch.photograph_sets import PhotographSet
from benchmarks.real_touch.scores import Reading

SHOWN = 4
"""Presses in a picture, evenly among those of known depth."""
FARTHEST = 0.3
"""mm at which the difference's colours end."""


def draw_presses(photographs: PhotographSet, readings: list[Reading], path: Path) -> None:
    """Draw depth, truth and difference of some presses."""
    with_depth = [pair for pair in zip(photographs.presses, readings, strict=True) if pair[0].absolute]
    selected = [with_depth[index] for index in np.linspace(1, len(with_depth) - 2, SHOWN).round().astype(int)]
    figure, axes = plt.subplots(SHOWN, 3, figsize=(6, 2 * SHOWN), squeeze=False, layout="constrained")
    for row, (press, reading) in zip(axes, selected, strict=True):
        truth = np.where(press.footprint, press.depth, np.nan)
        deepest = max(float(np.nanmax(truth)), float(reading.depth.max()))
        difference = (reading.depth - truth, -FARTHEST, FARTHEST, "RdBu")
        maps = [(reading.depth, 0.0, deepest, "viridis"), (truth, 0.0, deepest, "viridis"), difference]
        for ax, (values, low, high, colours), title in zip(row, maps, (f"{press.name}: read", "truth", "difference"), strict=True):
            figure.colorbar(ax.imshow(values, vmin=low, vmax=high, cmap=colours), ax=ax, shrink=0.8)
            ax.set_title(title, fontsize=8)
            ax.set_axis_off()
    figure.savefig(path, dpi=80)
    plt.close(figure)

"""The check of a manifest: its objects by category and split, what is left out, and a chart of them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.config.manifest import SPLITS, load_manifest
from pipeline.reports.picture_row import save_figure


def check(path: Path, picture: Path) -> list[str]:
    """Say what a manifest lists, and draw it; parameters, result and errors as `check_file`."""
    manifest = load_manifest(str(path))
    objects = manifest.objects()
    counts = Counter((item.category, item.split) for item in objects)
    categories = sorted({item.category for item in objects})
    figure = Figure((8, 1 + 0.3 * len(categories)), layout="constrained")
    axes, left, places = figure.subplots(), np.zeros(len(categories)), np.arange(len(categories))
    for split in SPLITS:
        width = np.array([counts[category, split] for category in categories])
        axes.barh(places, width, left=left, label=split)
        left += width
    axes.set(xlabel="objects", yticks=places, yticklabels=categories)
    axes.legend()
    save_figure(figure, picture)
    unitless = sum("file" in item.source and item.source.get("metres_per_unit") is None for item in objects)
    return [
        f"{path}: manifest {manifest.name}, {len(objects)} objects, no faults",
        *(f"{category}: " + ", ".join(f"{counts[category, split]} {split}" for split in SPLITS) for category in categories),
        *(f"left out {len(files)} files ({', '.join(files[:5])}): {reason}" for reason, files in manifest.left_out().items()),
        *([f"{unitless} objects have no unit and are scaled to one size; state metres_per_unit to keep theirs"] if unitless else []),
        f"picture: {picture}",
    ]

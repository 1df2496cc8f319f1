"""Learning curves: training and validation loss of every trained model, by epoch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import matplotlib
from matplotlib.figure import Figure
from pydantic import BaseModel, Field, TypeAdapter

from pipeline.errors import StoreError, first_line
from pipeline.reports.picture_row import save_figure
from pipeline.training.loop import METRICS, read_metrics

WIDTH, HEIGHT, DPI = 3.4, 2.6, 110
"""Inches of one model's curves, and dots per inch."""


def draw_curves(folders: Mapping[str, Path], path: Path) -> None:
    """Draw the curves of every model folder into a picture at `path`, PNG or SVG by suffix.

    Losses are on a logarithmic scale; a dot marks the epoch that was kept.
    """
    with matplotlib.rc_context({"font.size": 8}):
        columns = min(4, len(folders))
        rows = -(-len(folders) // columns)
        figure = Figure((WIDTH * columns, HEIGHT * rows), dpi=DPI, layout="constrained")
        for number, (name, folder) in enumerate(folders.items(), start=1):
            axes = figure.add_subplot(rows, columns, number)
            history = _losses(folder)
            epochs = range(1, len(history) + 1)
            valid = [row.loss for row in history]
            axes.semilogy(epochs, [row.train_loss for row in history], label="training", linewidth=1)
            axes.semilogy(epochs, valid, label="validation", linewidth=1)
            axes.plot([1 + valid.index(min(valid))], [min(valid)], "o", markersize=4, color=matplotlib.rcParams["text.color"])
            axes.set(title=name, xlabel="epoch", ylabel="loss")
            axes.legend(frameon=False)
        save_figure(figure, path, metadata={"Date": None} if path.suffix == ".svg" else None)


class _Losses(BaseModel):
    loss: float
    train_loss: float


def _losses(folder: Path) -> list[_Losses]:
    """Read the losses of each epoch; a `StoreError` where the file of a training says none."""
    try:
        return TypeAdapter(Annotated[list[_Losses], Field(min_length=1)]).validate_python(read_metrics(folder))
    except ValueError as error:  # pydantic's and those of JSON
        raise StoreError(
            f"{folder}: {METRICS} does not say the losses of each epoch ({first_line(error)}); train the model again"
        ) from error

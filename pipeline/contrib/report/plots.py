"""Draw the plots of a report as SVG files: bars, distributions, learning curves, and errors with intervals."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.drawing.colors import COLORS
from pipeline.drawing.plots import INK, themed_svg
from pipeline.kernels.metrics.bootstrap import Interval

DECADES = 3  # decades below a limit that a histogram shows; values beyond them, or a decade above it, count at its ends
HATCHES = ("", "//")  # hatches of bars, so that they differ without colours
LINES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "D", "^", "v")


def draw_bars(path: Path, bars: Mapping[str, ArrayLike], labels: Sequence[object], *, x: str, y: str) -> None:
    """Draw bars in groups as an SVG; each series has a height per label."""
    with themed_svg(path) as figure:
        axes, width = figure.subplots(), 0.8 / len(bars)
        for number, (name, values) in enumerate(bars.items()):
            color, hatch = _color(number), HATCHES[number % 2]
            places = np.arange(len(labels)) + (number - (len(bars) - 1) / 2) * width
            axes.bar(places, values, width, label=_label(name), color=color, hatch=hatch, edgecolor=INK, linewidth=0.6)
        axes.set(xlabel=x, ylabel=y, xticks=range(len(labels)), xticklabels=labels)
        axes.legend(frameon=False)


def draw_histogram(
    path: Path,
    values: Mapping[str, NDArray[np.floating]],  # (N,) by series
    *,
    x: str,
    y: str,
    limit: float | None = None,  # marked by a line; bins are over decades
) -> None:
    """Draw the distributions of series as lines over common bins, as an SVG."""
    with themed_svg(path) as figure:
        axes = figure.subplots()
        if limit is None:
            highest = max((float(np.max(series, initial=0)) for series in values.values()), default=0.0) or 1.0
            bins = np.linspace(0, highest, 25)
        else:
            bins = limit * np.logspace(-DECADES, 1, 6 * (DECADES + 1) + 1)
            values = {name: np.clip(series, bins[0], bins[-1]) for name, series in values.items()}
            axes.axvline(limit, color=INK, linewidth=1, linestyle=LINES[1])
            axes.set(xscale="log")
        for number, (name, series) in enumerate(values.items()):
            shares = 100 * np.histogram(series, bins)[0] / max(len(series), 1)
            axes.stairs(shares, bins, label=_label(name), color=_color(number), linewidth=1.6, linestyle=LINES[number % len(LINES)])
        axes.set(xlabel=x, ylabel=y)
        axes.legend(frameon=False)


def _label(name: str) -> str:
    """Return the label of a series in a legend, which would skip one that begins with an underscore."""
    return f" {name}" if name.startswith("_") else name


def draw_curves(train: Sequence[float], valid: Sequence[float], path: Path) -> None:
    """Draw the training and validation losses of a model by epoch as an SVG, with a dot at the epoch that was kept."""
    with themed_svg(path, (3.4, 2.4), font_size=8) as figure:
        axes, epochs = figure.subplots(), range(1, len(valid) + 1)
        axes.semilogy(epochs, train, label="training", linewidth=1)
        axes.semilogy(epochs, valid, label="validation", linewidth=1, linestyle=LINES[1])
        axes.plot([1 + valid.index(min(valid))], [min(valid)], "o", markersize=4, color=INK)
        axes.set(xlabel="epoch", ylabel="loss")
        axes.legend(frameon=False)


def draw_errors(
    path: Path,
    errors: Mapping[str, Mapping[str, Interval]],  # by series and inputs
    line: Mapping[str, float],  # reference values by inputs
    labels: Mapping[str, str],  # of the inputs, in their order; those without errors are not shown
    y: str,
) -> None:
    """Draw errors with their intervals, and reference values as a line, as an SVG."""
    shown = [name for name in labels if any(name in series for series in errors.values())]
    with themed_svg(path, (4.8, 3.2), font_size=10) as figure:
        axes, step = figure.subplots(), 0.6 / max(len(errors), 1)
        for number, (name, series) in enumerate(errors.items()):
            at = {inputs: shown.index(inputs) + (number - (len(errors) - 1) / 2) * step for inputs in series}
            for inputs, error in series.items():
                if np.isfinite([error.low, error.high]).all():
                    axes.plot([at[inputs]] * 2, [error.low, error.high], color=_color(number), linewidth=1.4)
            means = [error.mean for error in series.values()]
            axes.plot(list(at.values()), means, MARKERS[number % len(MARKERS)], color=_color(number), markersize=6, label=_label(name))
        ends = np.array([(shown.index(inputs) + side, error) for inputs, error in line.items() for side in (-0.45, 0.45, np.nan)])
        if len(ends):
            axes.plot(*ends.T, color=INK, linewidth=1.2, linestyle=LINES[1], label="training object retrieved in its place")
        axes.set(ylabel=y, xticks=range(len(shown)), xticklabels=[labels[name] for name in shown], xlim=(-0.5, len(shown) - 0.5))
        axes.set_ylim(bottom=0)
        axes.tick_params(axis="x", labelsize=8)
        axes.legend(frameon=False, fontsize=8)


def _color(number: int) -> tuple[float, ...]:
    return tuple(channel / 255 for channel in COLORS[number % len(COLORS)])

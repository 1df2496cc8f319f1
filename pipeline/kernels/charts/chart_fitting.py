"""Touch charts fitted to point clouds (supplement 2.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.kernels.charts.chart_optimizer import ChartOptimizer, ChartState
from pipeline.kernels.charts.fit_options import FitOptions, StopRule
from pipeline.kernels.charts.touch_chart import chart_square

CHARTS_AT_ONCE = 32
"""Charts fitted together: a CPU's overhead per step is then a tenth of the work, and memory some 30 MB."""


@dataclass(frozen=True)
class ChartFits:
    """Fitted charts.

    Attributes
    ----------
    vertices
        (N, side², 3) float64, sensor frame, m; those of `chart_square` where the cloud is empty.
    residual
        (N,) float64, m: root of the mean squared distance from the cloud's points to the chart's surface; 0 where the cloud is empty.
    loss
        (N,) float64, sensor widths²: the exact Chamfer distance when last checked; +inf where it never was, 0 where the cloud is empty.
    iterations
        (N,) int64: steps of Adam taken.
    stop_rule
        (N,) int64, `StopRule`: threshold, cap, too_few_points (none) or collapsed.
    """

    vertices: NDArray[np.float64]
    residual: NDArray[np.float64]
    loss: NDArray[np.float64]
    iterations: NDArray[np.int64]
    stop_rule: NDArray[np.int64]


def fit_charts(
    clouds: Sequence[NDArray[np.float64]],
    width: float,
    generators: Sequence[torch.Generator],
    *,
    aspect: float = 1.0,
    options: FitOptions | None = None,
    device: torch.device | str = "cpu",
) -> ChartFits:
    """Fit a chart to each cloud: Adam on its vertices, from the sensor's square, down the Chamfer distance of its samples.

    Parameters
    ----------
    clouds
        N clouds (n, 3), sensor frame, m; each n may differ, and be 0.
    width
        Of the sensor, m: losses are in its square.
    generators
        N CPU generators, one per chart. A chart follows from its cloud, its generator and the options, to the bit on a CPU with one
        thread; not from the charts beside it.
    aspect
        The sensor's height over its width.
    options
        `FitOptions()` if None.
    device
        Where charts are fitted.

    Returns
    -------
    N fits, in the order of the clouds; vertices in the sensor frame, m.

    Raises
    ------
    InvalidInput
        A cloud holds NaN or infinity.
    ValueError
        A cloud is not (n, 3), the width is not positive and finite, or there is not one generator per cloud.
    """
    if len(clouds) != len(generators):
        raise ValueError(f"{len(clouds)} clouds, {len(generators)} generators: there must be one per cloud")
    if not 0 < width < np.inf:
        raise ValueError(f"sensor width {width} m: it must be positive and finite")
    options = options or FitOptions()
    square, faces = chart_square(options.side, aspect)
    fits = ChartFits(
        vertices=np.repeat(square.numpy()[None] * width, len(clouds), axis=0),
        residual=np.zeros(len(clouds)),
        loss=np.zeros(len(clouds)),
        iterations=np.zeros(len(clouds), np.int64),
        stop_rule=np.full(len(clouds), StopRule.too_few_points, np.int64),
    )
    nonempty = [i for i, cloud in enumerate(clouds) if len(cloud)]
    for first in range(0, len(nonempty), CHARTS_AT_ONCE):
        batch = nonempty[first : first + CHARTS_AT_ONCE]
        scaled = [torch.as_tensor(np.asarray(clouds[i], np.float64), device=device) / width for i in batch]
        charts = [ChartState(cloud, options.cloud_points, generators[i]) for i, cloud in zip(batch, scaled, strict=True)]
        ChartOptimizer(charts, square.to(device), faces.to(device), options).run()
        for i, chart in zip(batch, charts, strict=True):
            fits.vertices[i], fits.residual[i] = chart.vertices * width, chart.residual * width
            fits.loss[i], fits.iterations[i], fits.stop_rule[i] = chart.loss, chart.steps, chart.stop_rule
    return fits

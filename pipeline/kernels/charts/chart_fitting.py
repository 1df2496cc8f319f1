"""Touch charts fitted to point clouds: many at once, each as if it were alone (supplement 2.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.kernels.charts.chart_batch import Batch, Chart, Sweep
from pipeline.kernels.charts.chart_square import chart_square
from pipeline.kernels.charts.fit_rule import FitRule, StopRule
from pipeline.kernels.metrics.chamfer import Target

AT_ONCE = 32
"""Charts fitted together: a CPU's overhead a step is then a tenth of the work, and memory some 30 MB."""


@dataclass(frozen=True)
class ChartFits:
    """Fitted charts.

    Attributes
    ----------
    vertices
        (N, side², 3) float64, sensor frame, m; those of `chart_square` where the cloud is empty.
    residual
        (N,) float64, m: root of the mean squared distance from the cloud's points to the chart's surface; 0 where it is empty.
    loss
        (N,) float64, sensor widths²: the exact Chamfer distance when last looked at; +inf where it never was, 0 where the cloud is empty.
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
    rule: FitRule | None = None,
    device: torch.device | str = "cpu",
    at_once: int = AT_ONCE,
) -> ChartFits:
    """Fit a chart to each cloud: Adam on its vertices, from the sensor's square, down the Chamfer distance of its samples.

    Parameters
    ----------
    clouds
        N clouds (n, 3), sensor frame, m; each n may differ, and be 0.
    width
        Of the sensor, m: losses are in its square.
    generators
        N CPU generators, one a chart. A chart's outcome follows from its cloud, its generator and the rule, to the bit on a CPU
        with one thread; not from the charts beside it.
    rule
        How, and when it is enough; `FitRule()` where left out.
    device
        Where it is done.
    at_once
        Charts fitted together; those that finish make room at once. Changes speed and memory, nothing else.

    Raises
    ------
    ValueError
        A cloud that is not (n, 3) or holds NaN or infinity, a width that is not positive and finite, or not one generator a cloud.
    """
    if len(clouds) != len(generators):
        raise ValueError(f"{len(clouds)} clouds, {len(generators)} generators: there must be one a cloud")
    if not 0 < width < np.inf:
        raise ValueError(f"sensor width {width} m: it must be positive and finite")
    rule = rule or FitRule()
    square, faces = chart_square(rule.side)
    fits = ChartFits(
        vertices=np.repeat(square.numpy()[None] * width, len(clouds), axis=0),
        residual=np.zeros(len(clouds)),
        loss=np.zeros(len(clouds)),
        iterations=np.zeros(len(clouds), np.int64),
        stop_rule=np.full(len(clouds), StopRule.too_few_points, np.int64),
    )
    waiting = [i for i in reversed(range(len(clouds))) if len(clouds[i])]
    batch = Batch(square.to(device), faces.to(device), rule)
    while waiting or batch.charts:
        while waiting and len(batch.charts) < at_once:
            i = waiting.pop()
            cloud = torch.as_tensor(np.asarray(clouds[i], np.float64), device=device) / width
            batch.add(Chart(i, _target(i, cloud), Sweep(cloud, rule.cloud_points, generators[i]), generators[i]))
        for ended in batch.step():
            i = ended.chart.index
            fits.vertices[i], fits.residual[i] = ended.vertices * width, ended.residual * width
            fits.loss[i], fits.iterations[i], fits.stop_rule[i] = ended.chart.loss, ended.chart.steps, ended.why
    return fits


def _target(i: int, cloud: torch.Tensor) -> Target:
    try:
        return Target(cloud)
    except ValueError as error:
        raise ValueError(f"cloud {i}: {error}") from None

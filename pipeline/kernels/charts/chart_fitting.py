"""Touch charts fitted to point clouds (supplement 2.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.charts.chart_steps import ChartState, chamfer_and_gradient, chart_area, descend, planar_grid, take_steps
from pipeline.kernels.charts.touch_chart import FitOptions, chart_square
from pipeline.kernels.geometry.signed_distance import rms_distance_to_surface
from pipeline.kernels.metrics.cloud_distances import sampling_floor
from pipeline.kernels.metrics.nearest_points import checked_cloud
from schemas.charts import StopRule

CHECK_MARGIN = 2.0  # times the halt, below which an estimate calls for a check: in 10 steps the loss falls by less
NEAR_FLOORS = 10.0
"""A chart is near its cloud once its loss is below this multiple of the sampling floor of `cloud_points`. Until then those points represent
the whole cloud: from afar many points are about equally near, and a search among all of them is ten times slower."""


@dataclass(frozen=True)
class ChartFits:
    """Fitted charts."""

    vertices: Array  # (N, side², 3) sensor frame, m; those of `chart_square` where the cloud is empty
    residual: Array  # (N,) m, RMS distance from cloud to chart's surface; 0 where the cloud is empty
    loss: Array  # (N,) sensor widths², exact Chamfer distance when last checked; +inf: never, 0: empty
    iterations: NDArray[np.int64]  # (N,) steps of Adam taken
    stop_rule: NDArray[np.int64]  # (N,) `StopRule`: threshold, cap, too_few_points (none) or collapsed


def fit_charts(
    clouds: Sequence[Array],  # N clouds (n, 3), sensor frame, m; each n may differ, and be 0
    width: float,  # m, of the sensor
    generators: Sequence[torch.Generator],  # N on the CPU, one per chart
    *,
    aspect: float = 1.0,  # the sensor's height over its width
    options: FitOptions | None = None,
) -> ChartFits:
    """Fit a chart to each cloud: Adam on its vertices, from the sensor's square, down the Chamfer distance of its samples."""
    options = options or FitOptions()
    square, faces = (tensor.numpy() for tensor in chart_square(options.side, aspect))
    fits = ChartFits(
        vertices=np.repeat(square[None] * width, len(clouds), axis=0),
        residual=np.zeros(len(clouds)),
        loss=np.zeros(len(clouds)),
        iterations=np.zeros(len(clouds), np.int64),
        stop_rule=np.full(len(clouds), StopRule.too_few_points, np.int64),
    )
    for i, (cloud, generator) in enumerate(zip(clouds, generators, strict=True)):
        if len(cloud):
            fit = _Fit(np.asarray(cloud, np.float64) / width, square, faces, options, generator)
            fits.stop_rule[i] = fit.run()
            fits.vertices[i], fits.residual[i] = fit.chart.vertices * width, fit.residual * width
            fits.loss[i], fits.iterations[i] = fit.loss, fit.steps
    return fits


class _Fit:
    """Fit a chart to a cloud (n, 3), n at least 1, from the vertices (V, 3) of a square; lengths are sensor widths."""

    def __init__(self, cloud: Array, square: Array, faces: NDArray[np.int64], options: FitOptions, generator: torch.Generator) -> None:
        self.options, self.generator, self.cloud = options, generator, np.ascontiguousarray(checked_cloud("the touch", cloud))
        count = len(cloud)
        size = min(options.cloud_points or count, count)
        order = torch.randperm(count, generator=generator).numpy() if size < count else np.arange(count)
        self.parts = self.cloud[order][: count // size * size].reshape(-1, size, 3)  # a smaller last part is dropped
        self.targets = planar_grid(self.parts[0]), planar_grid(self.cloud)
        self.chart = ChartState(square.copy(), np.zeros_like(square), np.zeros_like(square), faces)
        self.near_loss = np.inf if options.cloud_points is None else NEAR_FLOORS * sampling_floor(1.0, options.cloud_points) / 2
        self.steps, self.loss, self.residual = 0, np.inf, np.inf
        self.recent: list[float] = []

    def run(self) -> StopRule:
        """Take steps until a rule ends the fit."""
        options = self.options
        while (area := chart_area(self.chart)) > 0:
            if self._is_check(area):
                loss, gradient = chamfer_and_gradient(self.chart, self._draw(1, options.samples)[0], self.cloud, self.targets[1])
                if (rule := self._stop_rule(loss)) is not None:
                    return rule
                self.steps += 1
                descend(self.chart, gradient, self.steps, options.learning_rate)
            else:
                count = min(options.check_every - self.steps % options.check_every, options.max_iterations - self.steps)
                self._step(count)
        self._measure()
        return StopRule.collapsed

    def _is_check(self, area: float) -> bool:
        """Check whether the exact loss is due: at the cap, and each `check_every` steps once its estimate comes near the halt."""
        options = self.options
        always_exact = options.step_samples >= options.samples and options.cloud_points is None  # each step has all samples and points
        if always_exact or self.steps >= options.max_iterations:
            return True
        if not self.recent or self.steps % options.check_every:
            return False
        coarser = (sampling_floor(area, options.step_samples) - sampling_floor(area, options.samples)) / 2
        return float(np.mean(self.recent)) - coarser < CHECK_MARGIN * options.halt

    def _stop_rule(self, loss: float) -> StopRule | None:
        """Record the exact loss; return the rule that ends the fit, or None."""
        options, at_cap = self.options, self.steps >= self.options.max_iterations
        self._record([loss])
        self.loss, self.recent = loss, []
        if loss < options.halt or at_cap:
            self._measure()
        if loss < options.halt and (options.residual_limit is None or self.residual <= options.residual_limit):
            return StopRule.threshold
        return StopRule.cap if at_cap else None

    def _measure(self) -> None:
        self.residual = rms_distance_to_surface(self.cloud, self.chart.vertices, self.chart.faces)

    def _step(self, count: int) -> None:
        uniform = self._draw(count, self.options.step_samples)
        losses = take_steps(self.chart, uniform, self.parts, self.targets, self.near_loss, self.steps, self.options.learning_rate)
        self.steps += len(losses)
        self._record(losses.tolist())

    def _record(self, losses: list[float]) -> None:
        """Remember the last losses, and whether the chart has come near its cloud."""
        self.recent = (self.recent + losses)[-self.options.check_every :]
        if min(losses, default=np.inf) < self.near_loss:
            self.near_loss = np.inf  # it is near from now on

    def _draw(self, steps: int, samples: int) -> Array:  # (steps, samples, 3) in [0, 1]
        drawn: Array = torch.rand(steps, samples, 3, generator=self.generator, dtype=torch.float64).numpy()
        return drawn

"""Adam on many touch charts at once, each as if it were alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.charts.fit_options import FitOptions, StopRule
from pipeline.kernels.metrics.chamfer import Target
from pipeline.kernels.metrics.cloud_distances import sampling_floor
from pipeline.kernels.metrics.surface_distance import rms_distance_to_surface
from pipeline.kernels.metrics.surface_sampling import doubled_areas, map_to_surfaces

CHECK_MARGIN = 2.0
"""The exact loss is checked once its estimate is below this many halts: in 10 steps it falls by less than that."""
NEAR = 10.0
"""A chart is near its cloud once its loss is below this many sampling floors of `cloud_points`. Until then those points stand for the
whole cloud: from afar many points are about equally near, where a tree of all of them is ten times slower."""
BETAS = 0.9, 0.999
"""Adam's decays of the mean gradient and of its square, as published: the supplement names none."""
EPSILON = 1e-8
"""What Adam adds to the root of the mean square, as published."""


class CloudSampler:
    """Goes through a cloud again and again, `size` points at a time (None: all), in an order shuffled once."""

    def __init__(self, points: Tensor, size: int | None, generator: torch.Generator) -> None:
        self._size = len(points) if size is None else min(size, len(points))
        order = torch.randperm(len(points), generator=generator) if self._size < len(points) else torch.arange(len(points))
        self._points, self._start = points[order.to(points.device)], 0
        self.first = Target(self._points[: self._size])

    def next(self) -> Tensor:
        """Return the next points (size, 3); from the start again where too few are left."""
        if self._start + self._size > len(self._points):
            self._start = 0
        self._start += self._size
        return self._points[self._start - self._size : self._start]


@dataclass
class ChartState:
    """What belongs to one chart beside its vertices; lengths are sensor widths."""

    index: int
    cloud: Target
    sampler: CloudSampler
    generator: torch.Generator
    steps: int = 0
    loss: float = float("inf")
    near: bool = False
    residual: float = float("inf")
    recent: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class FinishedChart:
    """A chart that is done, its vertices (V, 3) in sensor widths, and why."""

    chart: ChartState
    vertices: NDArray[np.float64]
    stop_rule: StopRule


class ChartOptimizer:
    """Fits charts of one topology side by side; lengths are sensor widths.

    Parameters
    ----------
    square, faces
        Vertices (V, 3) float64 and faces (F, 3) of the undeformed chart.
    options
        How charts are fitted.
    """

    def __init__(self, square: Tensor, faces: Tensor, options: FitOptions) -> None:
        self.charts: list[ChartState] = []
        self._square, self._faces, self._options = square, faces, options
        self._state = square.new_zeros(3, 0, *square.shape)  # vertices, mean gradient, mean squared gradient: (3, B, V, 3)

    def add(self, chart: ChartState) -> None:
        """Begin a chart as the undeformed square."""
        fresh = torch.stack([self._square, torch.zeros_like(self._square), torch.zeros_like(self._square)])
        self._state = torch.cat([self._state, fresh[:, None]], dim=1)
        self.charts.append(chart)

    def step(self) -> list[FinishedChart]:
        """Take a step with each chart, except those that are done: these are removed and returned."""
        areas = [float(row.sum()) / 2 for row in doubled_areas(self._state[0], self._faces)]
        done = {i: StopRule.collapsed for i, area in enumerate(areas) if not area > 0}
        checked = [self._is_check(chart, area) for chart, area in zip(self.charts, areas, strict=True)]
        gradient = torch.zeros_like(self._state[0])
        for exact in (False, True):
            group = [i for i in range(len(self.charts)) if checked[i] == exact and i not in done]
            if group:
                losses, gradient[group] = self._losses(group, exact)
                for i, loss in zip(group, losses, strict=True):
                    stop_rule = self._judge(i, loss, exact)
                    if stop_rule is not None:
                        done[i] = stop_rule
        finished = [self._finish(i, stop_rule) for i, stop_rule in done.items()]
        if done:
            kept = [i for i in range(len(self.charts)) if i not in done]
            self._state, gradient, self.charts = self._state[:, kept], gradient[kept], [self.charts[i] for i in kept]
        self._descend(gradient)
        return finished

    def _is_check(self, chart: ChartState, area: float) -> bool:
        """Whether the exact loss is due: at the cap, and each `check_every` steps once its estimate comes near the halt."""
        options = self._options
        if options.always_exact or chart.steps >= options.max_iterations:
            return True
        if not chart.recent or chart.steps % options.check_every:
            return False
        coarser = (sampling_floor(area, options.step_samples) - sampling_floor(area, options.samples)) / 2
        return float(np.mean(chart.recent)) - coarser < CHECK_MARGIN * options.halt

    def _losses(self, group: list[int], exact: bool) -> tuple[list[float], Tensor]:
        """The Chamfer distance of each chart of the group, exact or a step's, and its gradient (group, V, 3)."""
        charts = [self.charts[i] for i in group]
        count = self._options.samples if exact else self._options.step_samples
        uniform = torch.stack([torch.rand(count, 3, generator=chart.generator, dtype=torch.float64) for chart in charts])
        clouds = [chart.cloud.points if exact else chart.sampler.next() for chart in charts]
        targets = [chart.cloud if exact or chart.near else chart.sampler.first for chart in charts]
        vertices = self._state[0, group].requires_grad_()
        samples = map_to_surfaces(vertices, self._faces, uniform)  # (group, n, 3)
        drawn = samples.detach()
        nearest = torch.stack([target.points[target.nearest(row)] for target, row in zip(targets, drawn, strict=True)])
        back = torch.cat([Target(row).nearest(cloud) + i * count for i, (cloud, row) in enumerate(zip(clouds, drawn, strict=True))])
        to_cloud = (samples - nearest).square().sum(dim=-1)  # (group, n)
        to_chart = (samples.reshape(-1, 3).index_select(0, back) - torch.cat(clouds)).square().sum(dim=-1)
        each = zip(to_cloud, torch.split(to_chart, [len(cloud) for cloud in clouds]), strict=True)
        losses = torch.stack([a.mean() + b.mean() for a, b in each])  # row by row: no sum's order depends on the group
        (gradient,) = torch.autograd.grad(losses.sum(), vertices)
        return losses.tolist(), gradient

    def _judge(self, i: int, loss: float, exact: bool) -> StopRule | None:
        """Note a loss; where it is exact, whether the chart is done, and why."""
        chart, options = self.charts[i], self._options
        chart.recent = (chart.recent + [loss])[-options.check_every :]
        chart.near = chart.near or options.cloud_points is None or loss < NEAR * sampling_floor(1.0, options.cloud_points) / 2
        if not exact:
            return None
        chart.loss, chart.recent = loss, []
        limit = options.residual_limit
        if loss < options.halt and (limit is None or self._residual(i) <= limit):
            return StopRule.threshold
        return StopRule.cap if chart.steps >= options.max_iterations else None

    def _residual(self, i: int) -> float:
        """The RMS distance from the cloud to the chart's surface."""
        points, vertices, faces = (tensor.cpu().numpy() for tensor in (self.charts[i].cloud.points, self._state[0, i], self._faces))
        return rms_distance_to_surface(points, vertices, faces)

    def _finish(self, i: int, stop_rule: StopRule) -> FinishedChart:
        self.charts[i].residual = self._residual(i)
        return FinishedChart(self.charts[i], self._state[0, i].cpu().numpy().copy(), stop_rule)

    def _descend(self, gradient: Tensor) -> None:
        """Adam's step (Kingma and Ba, 2015, algorithm 1), each chart with its own count of steps."""
        for chart in self.charts:
            chart.steps += 1
        taken = gradient.new_tensor([chart.steps for chart in self.charts])[:, None, None]
        _, mean, square = self._state
        mean.mul_(BETAS[0]).add_(gradient, alpha=1 - BETAS[0])
        square.mul_(BETAS[1]).addcmul_(gradient, gradient, value=1 - BETAS[1])
        root = (square / (1 - BETAS[1] ** taken)).sqrt() + EPSILON
        self._state[0] -= self._options.learning_rate * (mean / (1 - BETAS[0] ** taken)) / root

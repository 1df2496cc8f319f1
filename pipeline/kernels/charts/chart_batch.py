"""Charts in fitting, a step of Adam at a time: tensors for what the steps change, a list for the rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.charts.fit_rule import FitRule, StopRule, residual
from pipeline.kernels.metrics.chamfer import Target, nearest
from pipeline.kernels.metrics.distances import sampling_floor
from pipeline.kernels.metrics.surface_samples import doubled_areas, surface_points

CHECK_MARGIN = 2.0
"""The exact loss is looked at once its estimate is below so many halts: in 10 steps it falls by less than that."""
NEAR = 10.0
"""Until the loss has come down to so many floors of `cloud_points`, those stand for the whole cloud: from afar many points are
about equally near, where a tree of all of them is ten times slower, and a step in the direction of either is as good."""
BETAS = 0.9, 0.999
"""Adam's decays of the mean gradient and of its square, as published: the supplement names none."""
EPSILON = 1e-8
"""What Adam adds to the root of the mean square, as published."""


class Sweep:
    """A cloud gone through again and again, `size` points at a time (None: all), in an order shuffled once."""

    def __init__(self, points: Tensor, size: int | None, generator: torch.Generator) -> None:
        self._size = len(points) if size is None else min(size, len(points))
        order = torch.randperm(len(points), generator=generator) if self._size < len(points) else torch.arange(len(points))
        self._points, self._start = points[order.to(points.device)], 0
        self.first = Target(self._points[: self._size])

    def next(self) -> Tensor:
        """(size, 3), the next points; from the start again where too few are left."""
        if self._start + self._size > len(self._points):
            self._start = 0
        self._start += self._size
        return self._points[self._start - self._size : self._start]


@dataclass
class Chart:
    """What a chart keeps beside its vertices: its cloud, in sensor widths, and where it stands."""

    index: int
    cloud: Target
    sweep: Sweep
    generator: torch.Generator
    steps: int = 0
    loss: float = float("inf")
    near: bool = False
    residual: float = float("inf")
    recent: list[float] = field(default_factory=list)

    def measure(self, vertices: Tensor, faces: Tensor) -> float:
        """See `chart_rule.residual`; sensor widths. It is noted, since who ends by it is asked for it again."""
        self.residual = residual(vertices.cpu().numpy(), faces.cpu().numpy(), self.cloud.points.cpu().numpy())
        return self.residual


@dataclass(frozen=True)
class Ended:
    """A chart that is done: its vertices (V, 3) and their residual, in sensor widths, and why."""

    chart: Chart
    vertices: NDArray[np.float64]
    residual: float
    why: StopRule


class Batch:
    """Charts of one topology that are fitted side by side, each as if it were alone; lengths are sensor widths."""

    def __init__(self, square: Tensor, faces: Tensor, rule: FitRule) -> None:
        self.charts: list[Chart] = []
        self._square, self._faces, self._rule = square, faces, rule
        self._state = square.new_zeros(3, 0, *square.shape)  # vertices, mean gradient, mean squared gradient: (3, B, V, 3)

    def add(self, chart: Chart) -> None:
        """Begin a chart as the undeformed square."""
        fresh = torch.stack([self._square, torch.zeros_like(self._square), torch.zeros_like(self._square)])
        self._state = torch.cat([self._state, fresh[:, None]], dim=1)
        self.charts.append(chart)

    def step(self) -> list[Ended]:
        """Take a step with every chart, except those that have ended: they are taken out and given back."""
        areas = self._areas()
        ended = {i: StopRule.collapsed for i, area in enumerate(areas) if not area > 0}
        looks = [self._is_look(chart, area) for chart, area in zip(self.charts, areas, strict=True)]
        gradient = torch.zeros_like(self._state[0])
        for look in (False, True):
            group = [i for i in range(len(self.charts)) if looks[i] == look and i not in ended]
            if group:
                losses, gradient[group] = self._losses(group, look)
                for i, loss in zip(group, losses, strict=True):
                    why = self._judge(i, loss, look)
                    if why is not None:
                        ended[i] = why
        given_back = [self._ended(i, why) for i, why in ended.items()]
        if ended:
            stay = [i for i in range(len(self.charts)) if i not in ended]
            self._state, gradient, self.charts = self._state[:, stay], gradient[stay], [self.charts[i] for i in stay]
        self._descend(gradient)
        return given_back

    def _areas(self) -> list[float]:
        return [float(row.sum()) / 2 for row in doubled_areas(self._state[0], self._faces)]

    def _is_look(self, chart: Chart, area: float) -> bool:
        """Whether the exact loss is due: at the cap, and every so many steps once its estimate comes near the halt."""
        rule = self._rule
        if rule.always_exact or chart.steps >= rule.max_iterations:
            return True
        if not chart.recent or chart.steps % rule.check_every:
            return False
        coarser = (sampling_floor(area, rule.step_samples) - sampling_floor(area, rule.samples)) / 2
        return float(np.mean(chart.recent)) - coarser < CHECK_MARGIN * rule.halt

    def _losses(self, group: list[int], look: bool) -> tuple[list[float], Tensor]:
        """The Chamfer distance of each chart of the group, exact or a step's, and its gradient (group, V, 3)."""
        charts = [self.charts[i] for i in group]
        count = self._rule.samples if look else self._rule.step_samples
        uniform = torch.stack([torch.rand(count, 3, generator=chart.generator, dtype=torch.float64) for chart in charts])
        clouds = [chart.cloud.points if look else chart.sweep.next() for chart in charts]
        targets = [chart.cloud if look or chart.near else chart.sweep.first for chart in charts]
        vertices = self._state[0, group].requires_grad_()
        samples = surface_points(vertices, self._faces, uniform)  # (group, n, 3)
        drawn = samples.detach()
        there = torch.stack([target.points[target.nearest(row)] for target, row in zip(targets, drawn, strict=True)])
        back = torch.cat([nearest(cloud, row) + i * count for i, (cloud, row) in enumerate(zip(clouds, drawn, strict=True))])
        to_cloud = (samples - there).square().sum(dim=-1)  # (group, n)
        to_chart = (samples.reshape(-1, 3).index_select(0, back) - torch.cat(clouds)).square().sum(dim=-1)
        each = zip(to_cloud, torch.split(to_chart, [len(cloud) for cloud in clouds]), strict=True)
        losses = torch.stack([a.mean() + b.mean() for a, b in each])  # row by row: no sum's order depends on the group
        (gradient,) = torch.autograd.grad(losses.sum(), vertices)
        return losses.tolist(), gradient

    def _judge(self, i: int, loss: float, look: bool) -> StopRule | None:
        """Note a loss; at a look, whether the chart is done, and why."""
        chart, rule = self.charts[i], self._rule
        chart.recent = (chart.recent + [loss])[-rule.check_every :]
        chart.near = chart.near or rule.cloud_points is None or loss < NEAR * sampling_floor(1.0, rule.cloud_points) / 2
        if not look:
            return None
        chart.loss, chart.recent = loss, []
        limit = rule.residual_limit
        if loss < rule.halt and (limit is None or chart.measure(self._state[0, i], self._faces) <= limit):
            return StopRule.threshold
        return StopRule.cap if chart.steps >= rule.max_iterations else None

    def _ended(self, i: int, why: StopRule) -> Ended:
        vertices, chart = self._state[0, i], self.charts[i]
        if why is not StopRule.threshold or self._rule.residual_limit is None:  # else it has just been measured
            chart.measure(vertices, self._faces)
        return Ended(chart, vertices.cpu().numpy().copy(), chart.residual, why)

    def _descend(self, gradient: Tensor) -> None:
        """Adam's step (Kingma and Ba, 2015, algorithm 1), each chart with its own count of steps."""
        for chart in self.charts:
            chart.steps += 1
        taken = gradient.new_tensor([chart.steps for chart in self.charts])[:, None, None]
        _, mean, square = self._state
        mean.mul_(BETAS[0]).add_(gradient, alpha=1 - BETAS[0])
        square.mul_(BETAS[1]).addcmul_(gradient, gradient, value=1 - BETAS[1])
        root = (square / (1 - BETAS[1] ** taken)).sqrt() + EPSILON
        self._state[0] -= self._rule.learning_rate * (mean / (1 - BETAS[0] ** taken)) / root

"""Adam on many touch charts at once, independently of each other."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.charts.fit_options import FitOptions, StopRule
from pipeline.kernels.geometry.signed_distance import rms_distance_to_surface
from pipeline.kernels.metrics.chamfer import SearchCloud
from pipeline.kernels.metrics.cloud_distances import sampling_floor
from pipeline.kernels.metrics.surface_regularisers import neighbouring_vertices
from pipeline.kernels.metrics.surface_sampling import doubled_areas, map_to_surfaces

CHECK_MARGIN = 2.0
"""The exact loss is checked once its estimate is below this multiple of the halt: in 10 steps it falls by less than that."""
NEAR_FLOORS = 10.0
"""A chart is near its cloud once its loss is below this multiple of the sampling floor of `cloud_points`. Until then those points represent
the whole cloud: from afar many points are about equally near, and a tree of all of them is ten times slower."""
BETAS = 0.9, 0.999
"""Adam's decays of the mean gradient and of its square, as published: the supplement names none."""
EPSILON = 1e-8
"""What Adam adds to the root of the mean square, as published."""


class ChartState:
    """One chart: its cloud and the progress of its fit; lengths are sensor widths.

    Parameters
    ----------
    cloud
        (n, 3) float64, n at least 1.
    cloud_points
        Steps cycle through the cloud, this number of points at a time (None: all), in an order that is shuffled once.
    generator
        Shuffles the cloud and draws the chart's samples.
    """

    def __init__(self, cloud: Tensor, cloud_points: int | None, generator: torch.Generator) -> None:
        size = min(cloud_points or len(cloud), len(cloud))
        order = torch.randperm(len(cloud), generator=generator) if size < len(cloud) else torch.arange(len(cloud))
        parts = torch.split(cloud[order.to(cloud.device)], size)[: len(cloud) // size]  # a smaller last part is left out
        self.cloud, self.first_part, self.parts = SearchCloud(cloud), SearchCloud(parts[0]), cycle(parts)
        self.generator = generator
        self.steps = 0
        self.loss = self.residual = float("inf")
        self.recent: list[float] = []
        self.near = False
        self.vertices: NDArray[np.float64]  # (V, 3); this and the rule are set once the chart is done
        self.stop_rule: StopRule


class ChartOptimizer:
    """Fits charts of one topology side by side, from the undeformed square on.

    Parameters
    ----------
    charts
        At least one; `run` sets their `vertices`, `residual` and `stop_rule`.
    square, faces
        Vertices (V, 3) float64, sensor widths, and faces (F, 3) of the undeformed chart.
    options
        How charts are fitted.
    """

    def __init__(self, charts: list[ChartState], square: Tensor, faces: Tensor, options: FitOptions) -> None:
        self._charts, self._faces, self._options = charts, faces, options
        self._state = square.new_zeros(3, len(charts), *square.shape)  # vertices, mean gradient, mean squared gradient: (3, B, V, 3)
        self._state[0] = square
        self._edge_matrix = options.edge_weight * _squared_edges(faces, len(square)).to(square) if options.edge_weight else None

    def run(self) -> None:
        """Take steps with each chart until all are done."""
        while self._charts:
            self._step()

    def _step(self) -> None:
        """Take a step with each chart, except those that are done: these are removed."""
        areas = [float(row.sum()) / 2 for row in doubled_areas(self._state[0], self._faces)]
        done = {i: StopRule.collapsed for i, area in enumerate(areas) if not area > 0}
        checked = [self._is_check(chart, area) for chart, area in zip(self._charts, areas, strict=True)]
        gradient = torch.zeros_like(self._state[0])
        for exact in (False, True):
            group = [i for i in range(len(self._charts)) if checked[i] == exact and i not in done]
            if group:
                losses, gradient[group] = self._losses(group, exact)
                rules = [self._check_stop_rule(i, loss, exact) for i, loss in zip(group, losses, strict=True)]
                done |= {i: rule for i, rule in zip(group, rules, strict=True) if rule is not None}
        for i, rule in done.items():
            chart = self._charts[i]
            chart.vertices, chart.residual, chart.stop_rule = self._state[0, i].cpu().numpy().copy(), self._residual(i), rule
        if done:
            remaining = [i for i in range(len(self._charts)) if i not in done]
            self._state, gradient, self._charts = self._state[:, remaining], gradient[remaining], [self._charts[i] for i in remaining]
        self._descend(gradient)

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
        """Compute the Chamfer distance of each chart of the group, exact or a step's, and its gradient (group, V, 3)."""
        charts = [self._charts[i] for i in group]
        count = self._options.samples if exact else self._options.step_samples
        uniform = torch.stack([torch.rand(count, 3, generator=chart.generator, dtype=torch.float64) for chart in charts])
        clouds = [chart.cloud.points if exact else next(chart.parts) for chart in charts]
        targets = [chart.cloud if exact or chart.near else chart.first_part for chart in charts]
        vertices = self._state[0, group].requires_grad_()
        samples = map_to_surfaces(vertices, self._faces, uniform)  # (group, n, 3)
        detached = samples.detach()
        nearest = torch.stack([target.points[target.nearest(row)] for target, row in zip(targets, detached, strict=True)])
        matches = torch.cat(
            [SearchCloud(row).nearest(cloud) + i * count for i, (cloud, row) in enumerate(zip(clouds, detached, strict=True))]
        )
        to_cloud = (samples - nearest).square().sum(dim=-1)  # (group, n)
        to_chart = (samples.reshape(-1, 3).index_select(0, matches) - torch.cat(clouds)).square().sum(dim=-1)
        pairs = zip(to_cloud, torch.split(to_chart, [len(cloud) for cloud in clouds]), strict=True)
        losses = torch.stack([a.mean() + b.mean() for a, b in pairs])  # row by row: no sum's order depends on the group
        (gradient,) = torch.autograd.grad(losses.sum(), vertices)
        if self._edge_matrix is not None:
            gradient = gradient + torch.stack([2 * self._edge_matrix @ chart for chart in vertices.detach()])  # one by one, as above
        return losses.tolist(), gradient

    def _check_stop_rule(self, i: int, loss: float, exact: bool) -> StopRule | None:
        """Record a chart's loss; if it is exact, return the rule that ends the fit, or None."""
        chart, options = self._charts[i], self._options
        chart.recent = (chart.recent + [loss])[-options.check_every :]
        chart.near = chart.near or options.cloud_points is None or loss < NEAR_FLOORS * sampling_floor(1.0, options.cloud_points) / 2
        if not exact:
            return None
        chart.loss, chart.recent = loss, []
        if loss < options.halt and (options.residual_limit is None or self._residual(i) <= options.residual_limit):
            return StopRule.threshold
        return StopRule.cap if chart.steps >= options.max_iterations else None

    def _residual(self, i: int) -> float:
        """Compute the RMS distance from the cloud to the chart's surface."""
        points, vertices, faces = (tensor.cpu().numpy() for tensor in (self._charts[i].cloud.points, self._state[0, i], self._faces))
        return rms_distance_to_surface(points, vertices, faces)

    def _descend(self, gradient: Tensor) -> None:
        """Adam's step (Kingma and Ba, 2015, algorithm 1), each chart with its own count of steps."""
        for chart in self._charts:
            chart.steps += 1
        steps = gradient.new_tensor([chart.steps for chart in self._charts])[:, None, None]
        _, mean, square = self._state
        mean.mul_(BETAS[0]).add_(gradient, alpha=1 - BETAS[0])
        square.mul_(BETAS[1]).addcmul_(gradient, gradient, value=1 - BETAS[1])
        root = (square / (1 - BETAS[1] ** steps)).sqrt() + EPSILON
        self._state[0] -= self._options.learning_rate * (mean / (1 - BETAS[0] ** steps)) / root


def _squared_edges(faces: Tensor, vertices: int) -> Tensor:
    """Make the (V, V) matrix M with tr(xᵀ M x) the mean squared edge length of vertices x (V, 3): the graph's Laplacian over its edges."""
    start, end = neighbouring_vertices(faces.cpu().numpy()).unbind(dim=1)
    joined = torch.zeros(vertices, vertices, dtype=torch.float64)
    joined[start, end] = joined[end, start] = 1
    return (torch.diag(joined.sum(dim=1)) - joined) / len(start)

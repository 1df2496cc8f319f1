"""Shortcuts of the stages that learn, on random inputs of the usual sizes and untrained networks."""

from __future__ import annotations

from functools import cached_property
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.charts import SENSOR, press
from benchmarks.gcn import Given, batch
from benchmarks.tradeoff.shortcut import Results, Shortcut
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.charts.fit_options import FitOptions
from pipeline.kernels.networks.chart_graph import ChartGraph
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS

GRASPS, SENSORS = 5, 4
PRESSED = "cap", "edge", "flat"
"""What is pressed in where charts are fitted."""
ALL_SAMPLES = FitOptions(step_samples=4000, cloud_points=SENSOR.rows * SENSOR.cols)
"""Steps that see all of chart and cloud, checked as often as others: `cloud_points=None` would check after every step."""
CHARTS_APART = 3e-5
"""m RMS on average: with steps that see all, such charts come out 0.9e-5 to 2.4e-5 nearer to their clouds than 1.2e-4 to 1.5e-4."""


class Bench:
    """Networks of the default sizes, or smaller ones, and what they are given."""

    def __init__(self, items: int = 2, layers: int = 8, features: int = 96) -> None:
        self.items = items
        self._sizes = {"gcn_layers": layers, "gcn_features": features}

    @cached_property
    def network(self) -> DeformationNetwork:
        config = CONFIGURATIONS["touch"].model_copy(update=self._sizes)
        return DeformationNetwork(config, torch.Generator().manual_seed(0)).eval()

    @cached_property
    def given(self) -> Given:
        return batch(self.items, GRASPS) | {"images": None, "camera": None}

    @cached_property
    def pressed(self) -> list[NDArray[np.float64]]:
        """Clouds (n, 3) in the gel, m."""
        rng = np.random.default_rng(0)
        return [press(kind, rng) for kind in PRESSED]


def shortcuts(bench: Bench) -> list[Shortcut]:
    """List the shortcuts of these stages."""
    return [
        Shortcut(
            *("fit-charts", "fewer samples per step", "samples and points beyond 500 in a step's loss; what halts is exact"),
            *(lambda: _fits(bench, FitOptions()), lambda: _fits(bench, ALL_SAMPLES)),
            bound=CHARTS_APART,
            unit="m RMS",
        ),
        Shortcut(
            *("train-gcn", "sparse neighbours", "products with pairs of vertices that are no neighbours"),
            *(lambda: _deformed(bench), lambda: _dense(bench)),
            bound=1e-6,
            unit="m",
        ),
        Shortcut(
            *("evaluate", "each case once", "all grasps given once more for every first grasp"),
            *(lambda: _reconstructed(bench, 1), lambda: _reconstructed(bench, GRASPS)),
            bound=1e-6,
            unit="m",
        ),
    ]


def _fits(bench: Bench, options: FitOptions) -> Results:
    """How far clouds are from their charts, on average, and why each fit ended."""
    generators = [torch.Generator().manual_seed(number) for number in range(len(PRESSED))]
    fits = fit_charts(bench.pressed, SENSOR.width, generators, options=options)
    return {"residual": fits.residual.mean(), "stop_rule": fits.stop_rule}


def _deformed(bench: Bench) -> Results:
    with torch.no_grad():
        return {"vertices": bench.network(**bench.given).numpy()}


def _dense(bench: Bench) -> Results:
    dense: dict[int, tuple[ChartGraph, Tensor]] = {}  # each with its graph, which keeps the graph's id taken

    def average(graph: ChartGraph, features: Tensor) -> Tensor:
        if id(graph) not in dense:
            dense[id(graph)] = graph, graph.adjacency.to_dense() / graph.degree
        return dense[id(graph)][1] @ features

    with patch.object(ChartGraph, "average", average):
        return _deformed(bench)


def _reconstructed(bench: Bench, firsts: int) -> Results:
    """One item with all grasps, as they come, or once for every first grasp; what they have in common is compared."""
    vertices, touched = bench.given["touch_vertices"], bench.given["touched"]
    charts = GRASPS * SENSORS
    found = []
    with torch.no_grad():
        for first in range(firsts):
            order = torch.arange(charts).roll(-first * SENSORS)
            given = bench.given | {"touch_vertices": vertices[order], "touched": touched[order], "counts": [charts]}
            found.append(bench.network(**given)[0].numpy())
    return {f"{k}": found[k if firsts > 1 else 0] for k in range(GRASPS)}

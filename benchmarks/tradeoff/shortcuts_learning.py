"""Shortcuts of the stages that learn, on random inputs of the usual sizes and untrained networks."""

from __future__ import annotations

from functools import cached_property
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.charts import SENSOR, press
from benchmarks.gcn import batch
from benchmarks.tradeoff.shortcuts import Results, Shortcut
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.charts.fit_rule import FitRule
from pipeline.kernels.networks import zero_neighbour
from pipeline.kernels.networks.configurations import CONFIGURATIONS
from pipeline.kernels.networks.deformation import DeformationNetwork
from pipeline.kernels.networks.touch_losses import projected_chamfer_loss
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.models.touch_model import TouchModel

GRASPS, SENSORS = 5, 4
PRESSED = "cap", "edge", "flat"
"""What is pressed in where charts are fitted."""
ALL_SAMPLES = FitRule(step_samples=4000, cloud_points=SENSOR.rows * SENSOR.cols)
"""Steps that see all of chart and cloud, which are looked at as often as others: `cloud_points=None` would look after every step."""
CHARTS_APART = 3e-5
"""m RMS on average: with steps that see all, such charts come out 0.9e-5 to 2.4e-5 nearer to their clouds than 1.2e-4 to 1.5e-4."""
Given = tuple[Tensor, Tensor, Tensor, Tensor, list[int]]


class Bench:
    """Networks of the default sizes, or smaller ones, and what they are given."""

    def __init__(
        self,
        items: int = 2,
        layers: int = 8,
        features: int = 96,
        width: float = 0.5,
        unet: int = 8,
    ) -> None:
        self.items = items
        self._sizes = {"gcn_layers": layers, "gcn_features": features, "encoder_width": width}
        self._unet = unet

    @cached_property
    def network(self) -> DeformationNetwork:
        config = CONFIGURATIONS["occluded-touch"].model_copy(update=self._sizes)
        return DeformationNetwork(config, torch.Generator().manual_seed(0)).eval()

    @cached_property
    def felt(self) -> DeformationNetwork:
        config = CONFIGURATIONS["touch"].model_copy(update=self._sizes)
        return DeformationNetwork(config, torch.Generator().manual_seed(0)).eval()

    @cached_property
    def given(self) -> Given:
        return batch(self.items, GRASPS)

    @cached_property
    def model(self) -> TouchModel:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)
            return TouchModel(UNet(self._unet).eval(), SENSOR, untouched_image(SENSOR), 0.001)

    @cached_property
    def depths(self) -> NDArray[np.float32]:
        """(20, H, W) of shapes pressed in, m; +inf where nothing is in the gel."""
        rng = np.random.default_rng(0)
        found = np.full((GRASPS * SENSORS, *SENSOR.shape), np.inf, np.float32)
        x, y = pixel_centres(SENSOR)
        for depth in found:
            points = press("cap", rng)
            depth[np.searchsorted(y, points[:, 1]), np.searchsorted(x, points[:, 0])] = points[:, 2]
        return found

    @cached_property
    def readings(self) -> NDArray[np.uint8]:
        return np.stack([tactile_image(depth, SENSOR) for depth in self.depths])

    @cached_property
    def pressed(self) -> list[NDArray[np.float64]]:
        """Clouds (n, 3) in the gel, m."""
        rng = np.random.default_rng(0)
        return [press(kind, rng) for kind in PRESSED]


def shortcuts(bench: Bench) -> list[Shortcut]:
    """List the shortcuts of these stages."""
    return [
        Shortcut(
            *("train-unet", "fewer loss points", "points of a touch's Chamfer loss beyond 2000 (unbiased; one draw is compared)"),
            *(lambda: _loss(bench, 2000), lambda: _loss(bench, None)),
            bound=2e-6,
            unit="sensor widths²",
        ),
        Shortcut(
            *("fit-charts", "touched readings", "readings of sensors that touched nothing, here half of them"),
            *(lambda: _clouds(bench, half=True), lambda: _clouds(bench, half=False)),
            bound=1e-8,
            unit="m",
        ),
        Shortcut(
            *("fit-charts", "fewer samples a step", "samples and points beyond 500 in a step's loss; what halts is exact"),
            *(lambda: _fits(bench, FitRule()), lambda: _fits(bench, ALL_SAMPLES)),
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


def _loss(bench: Bench, points: int | None) -> Results:
    true = torch.from_numpy(bench.depths[:8])
    mask = torch.isfinite(true)
    predicted = torch.where(mask, true, 0) + 1e-4 * torch.randn(true.shape, generator=torch.Generator().manual_seed(0))
    generator = torch.Generator().manual_seed(1)
    loss = projected_chamfer_loss(predicted, true, mask, SENSOR.width, SENSOR.w, points, generator)
    return {"loss": np.array(float(loss))}


def _clouds(bench: Bench, half: bool) -> Results:
    chosen = np.arange(0, len(bench.readings), 2)
    clouds = bench.model.clouds(bench.readings[chosen] if half else bench.readings)
    return {f"{k}": clouds[k if half else at] for k, at in enumerate(chosen)}


def _fits(bench: Bench, rule: FitRule) -> Results:
    """How far clouds are from their charts, on average, and why each fit ended."""
    generators = [torch.Generator().manual_seed(number) for number in range(len(PRESSED))]
    fits = fit_charts(bench.pressed, SENSOR.width, generators, rule)
    return {"residual": fits.residual.mean(), "stop_rule": fits.stop_rule}


def _deformed(bench: Bench) -> Results:
    with torch.no_grad():
        return {"vertices": bench.network(*bench.given).numpy()}


def _dense(bench: Bench) -> Results:
    dense: dict[int, tuple[Tensor, Tensor]] = {}  # each with what it was made of, which keeps its id taken

    def product(matrix: Tensor, columns: Tensor) -> Tensor:
        if id(matrix) not in dense:
            dense[id(matrix)] = matrix, matrix.to_dense()
        return dense[id(matrix)][1] @ columns

    with patch.object(zero_neighbour, "_product", product):
        return _deformed(bench)


def _reconstructed(bench: Bench, firsts: int) -> Results:
    """One item with all grasps, as they come, or once for every first grasp; what they have in common is compared."""
    _, _, vertices, touched, _ = bench.given
    charts = GRASPS * SENSORS
    found = []
    with torch.no_grad():
        for first in range(firsts):
            order = torch.arange(charts).roll(-first * SENSORS)
            found.append(bench.felt(None, None, vertices[order], touched[order], [charts])[0].numpy())
    return {f"{k}": found[k if firsts > 1 else 0] for k in range(GRASPS)}

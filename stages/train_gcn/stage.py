"""Supplement 3: learn to deform a sphere of vision charts around the touch charts, from what is seen and felt."""

from __future__ import annotations

from typing import Any

import torch

from pipeline.engine.stage import Cost
from pipeline.kernels.charts.touch_chart import SIDE
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.training.reconstruction import Materials, ReconstructionTraining
from schemas.surfaces import SURFACES
from stages.train_gcn.learner import GcnLearner
from stages.train_gcn.settings import GcnSettings


class TrainGcn(ReconstructionTraining):
    """Trains a network that deforms vision charts to the whole surface."""

    name = "train-gcn"
    summary = "Train the graph network that deforms vision charts, in one of the supplement's configurations."
    settings_type = GcnSettings
    target = SURFACES
    learned = ("points",)

    def grid(self, settings: GcnSettings) -> dict[str, tuple[Any, ...]]:
        """Give the grid of supplement 3.4; without an image there is no encoder to vary."""
        encoders = {"encoder_layers": (12, 15, 18)} if settings.named.image else {}
        rates, layers, features = (1e-4, 3e-5, 1e-5), (15, 20, 25), (150, 200, 250)
        return {"learning_rate": rates, **encoders, "gcn_layers": layers, "gcn_features": features}

    def cost(self, settings: GcnSettings, objects: int) -> Cost:
        """Estimate about a second per item at the tables' sizes on one core, less in proportion to the network's."""
        network = settings.network(SIDE)
        share = network.gcn_layers * network.gcn_features**2 / (20 * 250**2)
        return Cost(seconds=objects * settings.items * settings.epochs * (0.02 + 0.9 * share), kilobytes=8000 * share + 500)

    def network(self, settings: GcnSettings, side: int, generator: torch.Generator) -> DeformationNetwork:
        """Make the network, for touch charts of side x side vertices."""
        return DeformationNetwork(settings.network(side), generator)

    def learner(self, network: DeformationNetwork, materials: Materials) -> GcnLearner:
        """Make what trains the network."""
        return GcnLearner(network, materials)

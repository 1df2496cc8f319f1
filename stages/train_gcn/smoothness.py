"""What a loss adds for the crumpling that a Chamfer distance does not see; nothing by default, as in the supplement."""

from __future__ import annotations

import torch
from torch import Tensor

from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.metrics.surface_regularisers import bending, edge_length, laplacian, neighbouring_faces, neighbouring_vertices
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from stages.train_gcn.settings import GcnSettings


class Smoothness:
    """The weighted terms of the settings, of the closed surface that vertices that coincide make together."""

    def __init__(self, network: DeformationNetwork, settings: GcnSettings) -> None:
        self._network, self._settings = network, settings
        faces = network.charts.position[network.charts.faces]
        self._faces, self._edges, self._pairs = torch.tensor(faces), neighbouring_vertices(faces), neighbouring_faces(faces)
        sphere = torch.tensor(network.config.radius * network.charts.vertices + network.config.centre)  # (V, 3), m
        self._start = network.merged(sphere[None])

    def __call__(self, deformed: Tensor) -> Tensor:
        """Compute the sum of the terms of vision charts (B, V, 3), mean over the items; terms without weight are not computed."""
        settings, total = self._settings, deformed.new_zeros(())
        if not (settings.edge_weight or settings.laplacian_weight or settings.bending_weight):
            return total
        surface = self._network.merged(deformed)
        if settings.edge_weight:
            total = total + TABLE_3_FACTOR * settings.edge_weight * edge_length(surface, self._edges).mean()
        if settings.laplacian_weight:
            moved = surface - self._start.to(surface)
            total = total + TABLE_3_FACTOR * settings.laplacian_weight * laplacian(moved, self._edges).mean()
        if settings.bending_weight:
            total = total + settings.bending_weight * bending(surface, self._faces, self._pairs).mean()
        return total

"""The loss of `train-gcn`: the distance of the predicted surface to the object's."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from pipeline.kernels.geometry.mesh import mesh_edges
from pipeline.kernels.metrics.chamfer import SearchCloud, squared_distances
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.metrics.surface_sampling import edge_length, sample_surface
from pipeline.models.deformation_reconstruction import assemble_surfaces
from pipeline.models.observation import NetworkBatch
from pipeline.training.items import Items
from pipeline.training.reconstruction import Batch, ReconstructionLearner


class GcnLearner(ReconstructionLearner):
    """Minimise the distance of the predicted surface to the object's (supplement 3.3), and the weighted length of the predicted edges."""

    seeded_as = "train-gcn"

    def __init__(self, network: Any, train: Items, valid: Items, settings: Any, seed: int) -> None:
        super().__init__(network, train, valid, settings, seed)
        faces = network.charts.position[network.charts.faces]  # of the closed surface that vertices that coincide make together
        self._edges = torch.from_numpy(mesh_edges(faces)[0])

    def targets(self, items: Items, numbers: Sequence[int], generators: Sequence[torch.Generator], *, validates: bool) -> list[SearchCloud]:
        """Read the points of each item's object."""
        return [items.target(item) for item in numbers]

    def loss(self, network: Any, batch: Batch) -> Tensor:
        """Compute the items' mean Chamfer distance and weighted length of edges; the supplement lacks the latter."""
        inputs = self.stack(network, batch)
        deformed = network(**vars(inputs))
        total: Tensor = self._chamfer(deformed, inputs, batch).mean()
        if weight := TABLE_3_FACTOR * self.settings.edge_weight:
            total = total + weight * edge_length(self.network.merge_coinciding(deformed), self._edges).mean()
        return total

    def errors(self, network: Any, batch: Batch) -> Tensor:
        """Compute the Chamfer distance of each item, (B,)."""
        inputs = self.stack(network, batch)
        return self._chamfer(network(**vars(inputs)), inputs, batch)

    def _chamfer(self, deformed: Tensor, inputs: NetworkBatch, batch: Batch) -> Tensor:
        """Compute (B,) Chamfer distances of `loss_points` points each way to all the object's, in Table 3's unit."""
        distances, count = [], self.settings.loss_points
        surfaces = assemble_surfaces(self.network, deformed, inputs)
        for (vertices, faces), target, generator in zip(surfaces, batch.targets, batch.generators, strict=True):
            predicted = sample_surface(vertices, faces, count, generator)
            rows = torch.randperm(len(target.points), generator=generator)[:count]
            true = target.points[rows].to(predicted)
            surface = target.points.to(predicted) if predicted.is_cuda else target
            distances.append(squared_distances(predicted, surface).mean() + squared_distances(true, predicted).mean())
        return TABLE_3_FACTOR * torch.stack(distances)

"""What `train-gcn` minimises: the distance between the predicted surface and the object's (supplement 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from pipeline.kernels.metrics.chamfer import Target, squared_distances
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.metrics.surface_sampling import sample_surface
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.models.observation import NetworkBatch, Observation
from pipeline.models.reconstruction import assemble_surfaces
from pipeline.rng import torch_generator
from pipeline.training.reconstruction import Materials, ReconstructionLearner
from stages.train_gcn.smoothness import Smoothness


@dataclass(frozen=True)
class Batch:
    """Items that were read: what the network is given of each, the points it should find, and what draws the points of the loss."""

    observations: Sequence[Observation]
    targets: Sequence[Target]
    generators: Sequence[torch.Generator]


class GcnLearner(ReconstructionLearner):
    """A deformation network with its items: the Chamfer distance between points of the predicted surface and of the object's."""

    def __init__(self, network: DeformationNetwork, materials: Materials) -> None:
        super().__init__(network, materials)
        self._network, self._smoothness = network, Smoothness(network, materials.settings)

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read the items, each with as many grasps as are drawn for it."""
        return Batch(self.observe(items, generators), [self._train.target(item) for item in items], generators)

    def loss(self, batch: Batch) -> Tensor:
        """Compute the mean Chamfer distance of the items, and what their surfaces lack in smoothness."""
        deformed, seen = self._deform(batch)
        return self._chamfer(deformed, seen, batch).mean() + self._smoothness(deformed)

    def validate(self) -> dict[str, float]:
        """Compute the same with 1, 2, … grasps in turn, on points drawn the same in each epoch."""
        generator = torch_generator(self._seed, "train-gcn", "validate")
        found = []
        for chosen, observations in self.observe_in_turn():
            batch = Batch(observations, [self._valid.target(item) for item in chosen], [generator] * len(chosen))
            found.append(self._chamfer(*self._deform(batch), batch))
        return {"loss": float(torch.cat(found).double().mean())}

    def _deform(self, batch: Batch) -> tuple[Tensor, NetworkBatch]:
        """Move the vision charts of a batch: (B, V, 3), and what the network was given."""
        seen = self.stack(batch.observations)
        return self.module(**vars(seen)), seen

    def _chamfer(self, deformed: Tensor, seen: NetworkBatch, batch: Batch) -> Tensor:
        """Compute (B,) the Chamfer distance of each item, m² x `TABLE_3_FACTOR`, of `loss_points` points each way to all the object's."""
        surfaces = assemble_surfaces(self._network, deformed, seen)
        found = []
        for (vertices, faces), target, generator in zip(surfaces, batch.targets, batch.generators, strict=True):
            predicted = sample_surface(vertices, faces, self._settings.loss_points, generator)
            chosen = torch.randperm(len(target.points), generator=generator)[: self._settings.loss_points]
            true = target.points[chosen].to(predicted)
            surface = target.points.to(predicted) if predicted.is_cuda else target
            found.append(squared_distances(predicted, surface).mean() + squared_distances(true, predicted).mean())
        return TABLE_3_FACTOR * torch.stack(found)

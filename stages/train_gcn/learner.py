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
from pipeline.models.observation import NetworkBatch, Observation, stack_observations
from pipeline.models.reconstruction import assemble_surfaces
from pipeline.rng import torch_generator
from pipeline.training.learner import Learner
from stages.train_gcn.items import Items
from stages.train_gcn.settings import GcnSettings
from stages.train_gcn.smoothness import Smoothness


@dataclass(frozen=True)
class Batch:
    """Items that were read: what the network is given of each, the points it should find, and what draws the points of the loss."""

    observations: Sequence[Observation]
    targets: Sequence[Target]
    generators: Sequence[torch.Generator]


class GcnLearner(Learner):
    """A deformation network with its items: the Chamfer distance between points of the predicted surface and of the object's."""

    def __init__(self, network: DeformationNetwork, train: Items, valid: Items, settings: GcnSettings, seed: int) -> None:
        super().__init__(network)
        self._train, self._valid, self._settings, self._seed = train, valid, settings, seed
        self._network, self._camera = network, train.camera
        self._smoothness = Smoothness(network, settings)
        self._fewest, self._most = (min(asked, train.grasps) for asked in (settings.min_grasps, settings.max_grasps))

    def __len__(self) -> int:
        return len(self._train)

    def describe(self, item: int) -> str:
        """Name an item's object and first grasp."""
        return self._train.name(item)

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read the items, each with as many grasps as are drawn for it."""
        drawn = zip(items, generators, strict=True)
        observations = [self._train.drawn_view(item, self._fewest, self._most, generator) for item, generator in drawn]
        return Batch(observations, [self._train.target(item) for item in items], generators)

    def loss(self, batch: Batch) -> Tensor:
        """Compute the mean Chamfer distance of the items, and what their surfaces lack in smoothness."""
        deformed, seen = self._deform(batch)
        return self._chamfer(deformed, seen, batch).mean() + self._smoothness(deformed)

    def validate(self) -> dict[str, float]:
        """Compute the same with 1, 2, … grasps in turn, on points drawn the same in each epoch."""
        items, size = self._valid, self._settings.batch_size
        generator = torch_generator(self._seed, "train-gcn", "validate")
        found = []
        for start in range(0, len(items), size):
            chosen = range(len(items))[start : start + size]
            observations = [items.view_in_turn(item, self._fewest, self._most) for item in chosen]
            batch = Batch(observations, [items.target(item) for item in chosen], [generator] * len(chosen))
            found.append(self._chamfer(*self._deform(batch), batch))
        return {"loss": float(torch.cat(found).double().mean())}

    def _deform(self, batch: Batch) -> tuple[Tensor, NetworkBatch]:
        """Move the vision charts of a batch: (B, V, 3), and what the network was given."""
        seen = stack_observations(batch.observations, self._network.config, self._camera, like=next(self.module.parameters()))
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

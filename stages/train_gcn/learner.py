"""What the graph network learns: to bring its surface close to the object's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import torch
from torch import Tensor

from pipeline.kernels.metrics.chamfer import Target, one_way
from pipeline.kernels.metrics.distances import TABLE_3_FACTOR
from pipeline.kernels.metrics.surface_samples import sample_surface
from pipeline.kernels.networks.deformation import DeformationNetwork
from pipeline.models.reconstruct import SurfaceTopology, View, assemble, deform
from pipeline.rng import torch_generator
from stages.train_gcn.items import Items
from stages.train_gcn.settings import GcnSettings


class GcnLearner:
    """Chamfer distance between points of the predicted surface and of the object (supplement 3.3)."""

    def __init__(self, network: DeformationNetwork, train: Items, valid: Items, settings: GcnSettings, seed: int) -> None:
        self.module: torch.nn.Module = network
        self._train, self._valid, self._settings, self._seed = train, valid, settings, seed

    def __len__(self) -> int:
        return len(self._train)

    @property
    def _network(self) -> DeformationNetwork:
        """The network where it is trained: Fabric wraps it, and of several processes each has its own."""
        return cast(DeformationNetwork, getattr(self.module, "module", self.module))

    def describe(self, item: int) -> str:
        """Object and first grasp."""
        return self._train.name(item)

    def loss(self, items: Sequence[int], generator: torch.Generator) -> Tensor:
        """Mean Chamfer distance of the items, each with as many grasps as are drawn for it."""
        fewest, most = self._grasps(self._train)
        views = []
        for item in items:
            count = int(torch.randint(fewest, most + 1, (), generator=generator))
            others = torch.randperm(self._train.grasps, generator=generator).numpy()
            views.append(self._train.view(item, self._train.grasps_of(item, count, others)))
        return self._chamfer(views, [self._train.target(item) for item in items], generator).mean()

    def validate(self) -> dict[str, float]:
        """The same with 1, 2, … grasps in turn; points drawn the same in every epoch."""
        items, size = self._valid, self._settings.batch_size
        generator = torch_generator(self._seed, "train-gcn", "validate")
        found = []
        for start in range(0, len(items), size):
            chosen = range(start, min(start + size, len(items)))
            fewest, most = self._grasps(items)
            counts = [fewest + item % items.each % (most - fewest + 1) for item in chosen]
            order = np.arange(items.grasps)
            views = [items.view(item, items.grasps_of(item, count, order)) for item, count in zip(chosen, counts, strict=True)]
            found.append(self._chamfer(views, [items.target(item) for item in chosen], generator))
        return {"loss": float(torch.cat(found).double().mean())}

    def _grasps(self, items: Items) -> tuple[int, int]:
        """Fewest and most grasps an item is given, of those there are."""
        return min(self._settings.min_grasps, items.grasps), min(self._settings.max_grasps, items.grasps)

    def _chamfer(self, views: Sequence[View], targets: Sequence[Target], generator: torch.Generator) -> Tensor:
        """(B,) Chamfer distance of every item in m² x `TABLE_3_FACTOR`: all of the object's points are near or not, some are asked."""
        batch = assemble(views, self._network)
        camera = None if self._train.camera is None else torch.from_numpy(self._train.camera)
        deformed = deform(self.module, batch, camera)
        if not bool(torch.isfinite(deformed).all()):
            return deformed.sum(dim=(1, 2))  # no number either: the training loop stops, and names the items
        found = []
        for (vertices, faces), target in zip(SurfaceTopology(self._network).surfaces(deformed, batch), targets, strict=True):
            predicted = sample_surface(vertices, faces, self._settings.loss_points, generator)
            asked = torch.randperm(len(target.points), generator=generator)[: self._settings.loss_points]
            points = target.points[asked].to(predicted)
            near = target.points.to(predicted) if predicted.is_cuda else target
            found.append(one_way(predicted, near).mean() + one_way(points, predicted).mean())
        return TABLE_3_FACTOR * torch.stack(found)

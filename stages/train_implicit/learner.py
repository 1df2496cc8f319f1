"""What `train-implicit` minimises: the mean error of the predicted distances, which are cut off at the band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pipeline.models.observation import Observation
from pipeline.rng import torch_generator
from pipeline.training.items import Items
from pipeline.training.reconstruction import ReconstructionLearner

LEARNED = ("query_points", "signed_distance")
"""The arrays of `distances` that are learned from."""


@dataclass(frozen=True)
class Batch:
    """Items that were read: what the network is given of each, and points (B, N, 3), world, m, with signed distances (B, N), m."""

    observations: Sequence[Observation]
    queries: Tensor
    distances: Tensor


class ImplicitLearner(ReconstructionLearner):
    """An implicit network with its items."""

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read the items, each with as many grasps as are drawn for it, and the points that are drawn for it."""
        return Batch(self.observe(items, generators), *_learned(self._train, items, self._settings.queries, generators))

    def loss(self, batch: Batch) -> Tensor:
        """Compute the mean absolute error of the distances within the band, as a share of the band."""
        seen = self.stack(batch.observations)
        found: Tensor = self.module(batch.queries.to(seen.touch_vertices), **vars(seen))
        band: float = self._settings.band
        return (found - batch.distances.to(found).clamp(-band, band)).abs().mean() / band

    def validate(self) -> dict[str, float]:
        """Compute the same with 1, 2, … grasps in turn, at points drawn the same in each epoch."""
        generator = torch_generator(self._seed, "train-implicit", "validate")
        total = 0.0
        for chosen, observations in self.observe_in_turn():
            learned = _learned(self._valid, chosen, self._settings.validation_queries, [generator] * len(chosen))
            total += len(chosen) * float(self.loss(Batch(observations, *learned)))
        return {"loss": total / len(self._valid)}


def _learned(items: Items, chosen: Sequence[int], count: int, generators: Sequence[torch.Generator]) -> tuple[Tensor, Tensor]:
    """Draw `count` points of each item, (B, N, 3) m, and their signed distances (B, N), m."""
    queries, distances = [], []
    for item, generator in zip(chosen, generators, strict=True):
        points, apart = (items.rows.read(name, items.object_of(item)) for name in LEARNED)
        drawn = torch.randint(len(points), (count,), generator=generator).numpy()
        queries.append(points[drawn])
        distances.append(apart[drawn])
    return torch.from_numpy(np.stack(queries)), torch.from_numpy(np.stack(distances))

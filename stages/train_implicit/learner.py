"""What `train-implicit` minimises: the mean error of the predicted distances, which are cut off at the band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.models.observation import Observation, stack_observations
from pipeline.rng import torch_generator
from pipeline.training.learner import Learner
from stages.train_gcn.items import Items
from stages.train_implicit.settings import ImplicitSettings

LEARNED = ("query_points", "signed_distance")
"""The arrays of `distances` that are learned from."""


@dataclass(frozen=True)
class Batch:
    """Items that were read: what the network is given of each, and points (B, N, 3), world, m, with signed distances (B, N), m."""

    observations: Sequence[Observation]
    queries: Tensor
    distances: Tensor


class ImplicitLearner(Learner):
    """An implicit network with its items."""

    def __init__(self, network: ImplicitNetwork, train: Items, valid: Items, settings: ImplicitSettings, seed: int) -> None:
        super().__init__(network)
        self._train, self._valid, self._settings, self._seed = train, valid, settings, seed
        self._config, self._camera = network.config, train.camera
        self._fewest, self._most = (min(asked, train.grasps) for asked in (settings.min_grasps, settings.max_grasps))

    def __len__(self) -> int:
        return len(self._train)

    def describe(self, item: int) -> str:
        """Name an item's object and first grasp."""
        return self._train.name(item)

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read the items, each with as many grasps as are drawn for it, and the points that are drawn for it."""
        drawn = zip(items, generators, strict=True)
        observations = [self._train.drawn_view(item, self._fewest, self._most, generator) for item, generator in drawn]
        return Batch(observations, *_learned(self._train, items, self._settings.queries, generators))

    def loss(self, batch: Batch) -> Tensor:
        """Compute the mean absolute error of the distances within the band, as a share of the band."""
        seen = stack_observations(batch.observations, self._config, self._camera, like=next(self.module.parameters()))
        found: Tensor = self.module(batch.queries.to(seen.touch_vertices), **vars(seen))
        band = self._config.band
        return (found - batch.distances.to(found).clamp(-band, band)).abs().mean() / band

    def validate(self) -> dict[str, float]:
        """Compute the same with 1, 2, … grasps in turn, at points drawn the same in each epoch."""
        items, size = self._valid, self._settings.batch_size
        generator = torch_generator(self._seed, "train-implicit", "validate")
        found = []
        for start in range(0, len(items), size):
            chosen = range(len(items))[start : start + size]
            observations = [items.view_in_turn(item, self._fewest, self._most) for item in chosen]
            learned = _learned(items, chosen, self._settings.validation_queries, [generator] * len(chosen))
            found.append(len(chosen) * float(self.loss(Batch(observations, *learned))))
        return {"loss": sum(found) / len(items)}


def _learned(items: Items, chosen: Sequence[int], count: int, generators: Sequence[torch.Generator]) -> tuple[Tensor, Tensor]:
    """Draw `count` points of each item, (B, N, 3) m, and their signed distances (B, N), m."""
    queries, distances = [], []
    for item, generator in zip(chosen, generators, strict=True):
        points, apart = (items.rows.read(name, items.object_of(item)) for name in LEARNED)
        drawn = torch.randint(len(points), (count,), generator=generator).numpy()
        queries.append(points[drawn])
        distances.append(apart[drawn])
    return torch.from_numpy(np.stack(queries)), torch.from_numpy(np.stack(distances))

"""`train-implicit`: learn the signed distance from any point in space to the object, from images and touches."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipeline.engine.stage import Cost
from pipeline.models.implicit_reconstruction import ImplicitReconstructor
from pipeline.training.augmentation import draw_misplacement, misplace
from pipeline.training.items import Items
from pipeline.training.reconstruction import Batch, ReconstructionLearner, ReconstructionTraining
from schemas.distances import DISTANCES
from stages.train_implicit.settings import ImplicitSettings

MISPLACED = 0.5
"""Share of the items with image and touches that are at a wrong place, if `placement_error` is not 0."""


class ImplicitLearner(ReconstructionLearner):
    """Minimise the mean error of the predicted distances, which are cut off at the band."""

    target, arrays, seeded_as = DISTANCES, ("query_points", "signed_distance"), "train-implicit"

    def targets(
        self, items: Items, numbers: Sequence[int], generators: Sequence[torch.Generator], *, validates: bool
    ) -> tuple[Tensor, Tensor]:
        """Draw points of each item, (B, N, 3) world, m, and their signed distances (B, N), m, scaled as its observation is."""
        count = self.settings.validation_queries if validates else self.settings.queries
        queries, distances = [], []
        for item, generator in zip(numbers, generators, strict=True):
            object_id = items.object_of(item)
            points, point_distances = (items.rows.read(name, object_id) for name in self.arrays)
            rows = torch.randint(len(points), (count,), generator=generator).numpy()
            queries.append(items.scaled(points[rows], object_id))
            distances.append(np.float32(items.scale(object_id)) * point_distances[rows])
        return torch.from_numpy(np.stack(queries)), torch.from_numpy(np.stack(distances))

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read items as every family does, some of them at a wrong pose if the settings ask for it."""
        batch, deviation = super().read(items, generators), self.settings.placement_error
        if not deviation:
            return batch
        config = self._config
        observations, (queries, distances) = list(batch.observations), batch.targets
        for number, (observation, generator) in enumerate(zip(batch.observations, generators, strict=True)):
            place = draw_misplacement(deviation, config.centre, config.radius, generator)
            is_chosen = float(torch.rand((), generator=generator, dtype=torch.float64)) < MISPLACED
            if is_chosen and observation.image is not None and observation.touched.any():
                observations[number] = misplace(observation.scaled(config.centre), place, np.array(config.centre))
                queries[number] = torch.from_numpy(place.moved(queries[number].numpy()))
                distances[number] *= place.scale
        return Batch(observations, (queries, distances), generators)

    def loss(self, network: Any, batch: Batch) -> Tensor:
        """Compute the mean absolute error of the distances within the band, as a share of the band."""
        inputs, (queries, distances) = self.stack(network, batch), batch.targets
        predicted: Tensor = network(queries.to(inputs.touch_vertices), **vars(inputs))
        band: float = self._config.band
        loss: Tensor = (predicted - distances.to(predicted).clamp(-band, band)).abs().mean() / band
        return loss

    def errors(self, network: Any, batch: Batch) -> Tensor:
        """Give each item the mean error of the batch, (B,), as all items have the same number of points."""
        return self.loss(network, batch).expand(len(batch.observations))


class TrainImplicit(ReconstructionTraining):
    """Train a network that predicts signed distances, from which marching cubes make a closed surface."""

    name = "train-implicit"
    summary = "Train an implicit network: signed distances at any point, from an image or touches or both."
    settings_type = ImplicitSettings
    family = ImplicitReconstructor
    learner = ImplicitLearner

    def cost(self, settings: ImplicitSettings, objects: int) -> Cost:
        """Estimate the time per item on one core, in proportion to its points and the squared features."""
        item_seconds = 0.01 + 0.02 * settings.queries / 500 * (settings.features / 128) ** 2
        return Cost(seconds=objects * settings.samples_per_object * settings.epochs * item_seconds, kilobytes=3000)

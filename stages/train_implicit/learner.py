"""The loss of `train-implicit`: the error of predicted distances."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipeline.kernels.geometry.transforms import transform_points
from pipeline.training.augmentation import draw_misplacement, misplace
from pipeline.training.items import Items
from pipeline.training.reconstruction import Batch, ReconstructionLearner

MISPLACED = 0.5
"""Share of the items with image and touches that are displaced, if `placement_error` is not 0."""


class ImplicitLearner(ReconstructionLearner):
    """Minimise the mean error of the predicted distances, which are cut off at the band."""

    seeded_as = "train-implicit"

    def targets(
        self, items: Items, numbers: Sequence[int], generators: Sequence[torch.Generator], *, validates: bool
    ) -> tuple[Tensor, Tensor]:
        """Draw points of each item, (B, N, 3) world, m, and their signed distances (B, N), m, scaled as its observation is."""
        count = self.settings.validation_queries if validates else self.settings.queries
        queries, distances = [], []
        for item, generator in zip(numbers, generators, strict=True):
            object_id = items.object_of(item)
            points, point_distances = (items.rows.read(name, object_id) for name in ("query_points", "signed_distance"))
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
            motion = draw_misplacement(deviation, config.centre, config.radius, generator)
            is_chosen = float(torch.rand((), generator=generator, dtype=torch.float64)) < MISPLACED
            if is_chosen and observation.image is not None and observation.touched.any():
                observations[number] = misplace(observation.scaled(config.centre), motion, np.array(config.centre))
                queries[number] = torch.from_numpy(transform_points(motion, queries[number].double().numpy()).astype(np.float32))
                distances[number] *= float(motion[0, 0])  # the scale
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

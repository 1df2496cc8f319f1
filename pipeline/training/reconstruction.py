"""The training of networks that reconstruct objects, for every family."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor

from pipeline.models.observation import NetworkBatch, Observation, stack_observations
from pipeline.rng import torch_generator
from pipeline.training.augmentation import vary_observation
from pipeline.training.items import Items
from pipeline.training.learner import Learner
from pipeline.training.settings import ReconstructionSettings


class Batch(NamedTuple):
    """Items for a training step."""

    observations: Sequence[Observation]
    targets: Any
    generators: Sequence[torch.Generator]  # one per item; they draw the points of the loss


class ReconstructionLearner(Learner):
    """Train a network that reconstructs; a family defines its targets and error."""

    seeded_as: ClassVar[str]  # names the generator of validation

    network: Any

    def __init__(self, network: Any, train: Items, valid: Items, settings: Any, seed: int) -> None:
        super().__init__(network)
        self.settings, self._train, self._valid, self._seed = settings, train, valid, seed
        self._config = network.config
        typed_settings: ReconstructionSettings = settings
        self._fewest, self._most = (min(count, train.grasps) for count in (typed_settings.min_grasps, typed_settings.max_grasps))

    @abstractmethod
    def targets(
        self,
        items: Items,
        numbers: Sequence[int],  # (B,) items
        generators: Sequence[torch.Generator],  # (B,), for targets that are drawn
        *,
        validates: bool,  # these are validation items
    ) -> Any:
        """Read the targets of items, as the family's loss takes them."""

    @abstractmethod
    def errors(self, network: Any, batch: Batch) -> Tensor:  # (B,)
        """Compute the error of each item of a batch."""

    def __len__(self) -> int:
        return len(self._train)

    def describe(self, item: int) -> str:
        """Name an item's object and first grasp."""
        return self._train.name(item)

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read items, each with as many grasps as are drawn for it, varied as the settings ask."""
        dropped, counts = self.settings.dropped_inputs, (self._fewest, self._most)
        views = [self._train.random_view(item, *counts, rng, dropped=dropped) for item, rng in zip(items, generators, strict=True)]
        observations = [vary_observation(observation, self.settings, rng) for observation, rng in zip(views, generators, strict=True)]
        return Batch(observations, self.targets(self._train, items, generators, validates=False), generators)

    def validate(self, network: Any) -> dict[str, float]:
        """Compute the mean error with 1, 2, … grasps in turn; draws are the same in each epoch."""
        generator, size = torch_generator(self._seed, self.seeded_as, "validate"), self.settings.batch_size
        errors = []
        for start in range(0, len(self._valid), size):
            numbers = range(len(self._valid))[start : start + size]
            observations = [self._valid.fixed_view(item, self._fewest, self._most) for item in numbers]
            generators = [generator] * len(numbers)
            targets = self.targets(self._valid, numbers, generators, validates=True)
            errors.append(self.errors(network, Batch(observations, targets, generators)))
        return {"loss": float(torch.cat(errors).double().mean())}

    def stack(self, network: Any, batch: Batch) -> NetworkBatch:
        """Stack a batch's observations as the network takes them, on its device."""
        return stack_observations(batch.observations, self._config, camera=None, like=next(network.parameters()))

"""Learner: a network with its items and its loss, for the training loop. It is declared without torch, as stages are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

from pipeline.rng import torch_generator

if TYPE_CHECKING:
    import torch
    from torch import Tensor, nn

    from pipeline.models.observation import Observation
    from pipeline.training.items import Items


class TrainingItems(Protocol):
    """The items of a split."""

    def __len__(self) -> int: ...

    def name(self, item: int) -> str:
        """Name an item, for the message that stops a training."""


class Learner(ABC):
    """A network with its items to train on and to validate by.

    The loop may train `network` in a wrapper: `loss` and `validate` take the network as an argument.
    """

    keeps_last: ClassVar[bool] = False  # the last epoch's weights, where validation does not tell which are best

    def __init__(self, network: nn.Module, train: Any, valid: Any, settings: Any) -> None:
        self.network, self.settings = network, settings
        self.train: TrainingItems = train
        self.valid: TrainingItems = valid

    @abstractmethod
    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Any:
        """Read a batch for `loss`, from the items and one (CPU) generator each, and nothing else.

        The loop calls it in a separate thread, during the training step of the previous batch. torch's default type is undefined there:
        state the type of each draw.
        """

    @abstractmethod
    def loss(self, network: nn.Module, batch: Any) -> Tensor:
        """Compute the training loss of a batch: a scalar, the mean over its items."""

    @abstractmethod
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Compute metrics on the validation split, deterministically; the least "loss" is the best epoch's."""

    def validation_batches(self) -> Iterator[range]:
        """List the validation items, a batch at a time."""
        items, size = range(len(self.valid)), self.settings.batch_size
        return (items[start : start + size] for start in items[::size])


class Batch(NamedTuple):
    """Items for a training step."""

    observations: Sequence[Observation]
    targets: Any
    generators: Sequence[torch.Generator]  # one per item; they draw the points of the loss


class ReconstructionLearner(Learner):
    """Train a network that reconstructs; a family defines its targets and error."""

    seeded_as: ClassVar[str]  # names the generator of validation
    network: Any
    train: Items
    valid: Items

    def __init__(self, network: Any, train: Items, valid: Items, settings: Any, seed: int) -> None:
        super().__init__(network, train, valid, settings)
        self.seed, self.config = seed, network.config
        self.fewest, self.most = (min(count, train.grasps) for count in (settings.min_grasps, settings.max_grasps))

    @abstractmethod
    def targets(
        self,
        items: Items,
        numbers: Sequence[int],  # (B,) items
        observations: Sequence[Observation],  # (B,) what the network sees of them
        generators: Sequence[torch.Generator],  # (B,), for targets that are drawn
        *,
        validates: bool,  # these are validation items
    ) -> Any:
        """Read the targets of items, as the family's loss takes them."""

    @abstractmethod
    def errors(self, network: Any, batch: Batch) -> Tensor:  # (B,)
        """Compute the error of each item of a batch."""

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        """Read items, each with as many grasps as are drawn for it, varied as the settings ask."""
        from pipeline.training.items import vary_observation

        dropped, counts = self.settings.dropped_inputs, (self.fewest, self.most)
        views = [self.train.random_view(item, *counts, rng, dropped=dropped) for item, rng in zip(items, generators, strict=True)]
        observations = [vary_observation(observation, self.settings, rng) for observation, rng in zip(views, generators, strict=True)]
        return Batch(observations, self.targets(self.train, items, observations, generators, validates=False), generators)

    def validate(self, network: Any) -> dict[str, float]:
        """Compute the mean error with 1, 2, … grasps in turn; draws are the same in each epoch."""
        import torch

        generator, errors = torch_generator(self.seed, self.seeded_as, "validate"), []
        for numbers in self.validation_batches():
            observations = [self.valid.fixed_view(item, self.fewest, self.most) for item in numbers]
            generators = [generator] * len(numbers)
            targets = self.targets(self.valid, numbers, observations, generators, validates=True)
            errors.append(self.errors(network, Batch(observations, targets, generators)))
        return {"loss": float(torch.cat(errors).double().mean())}

    def stack(self, network: Any, batch: Batch) -> Any:  # `ChartBatch` or `PointBatch`
        """Stack a batch's observations as the network takes them, on its device."""
        from pipeline.models.observation import stack_observations

        return stack_observations(batch.observations, self.config, camera=None, like=next(network.parameters()))

"""Learner: a network with its items and its loss, for the training loop."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor, nn


class Learner(ABC):
    """A network with its training items and its validation.

    The loop may train `network` in a wrapper: `loss` and `validate` take the network as an argument.
    """

    keeps_last: ClassVar[bool] = False  # the last epoch's weights, where validation does not tell which are best

    def __init__(self, network: nn.Module) -> None:
        self.network = network

    @abstractmethod
    def __len__(self) -> int:
        """Count the training items per epoch."""

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

    def describe(self, item: int) -> str:
        """Name an item, for the message that stops a training."""
        return f"item {item}"

"""What the training loop trains: a network, its items and its loss."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn


class Learner(ABC):
    """A network with its training items and its validation.

    Attributes
    ----------
    network
        What is trained. The loop may train it in a wrapper: `loss` and `validate` compute with the network that they are given.
    """

    def __init__(self, network: nn.Module) -> None:
        self.network = network

    @abstractmethod
    def __len__(self) -> int:
        """Count the training items per epoch."""

    @abstractmethod
    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Any:
        """Read what the loss of some items is computed from: it depends on the items and on one (CPU) generator each, and on nothing else.

        The loop calls it in a thread of its own, while the batch before is learned from. There torch's default type is not to be relied
        on: name the type of what is drawn.
        """

    @abstractmethod
    def loss(self, network: nn.Module, batch: Any) -> Tensor:
        """Compute the training loss of what was read: a scalar, the mean over its items."""

    @abstractmethod
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Compute metrics on the validation split, deterministically; the least "loss" is the best epoch's."""

    def describe(self, item: int) -> str:
        """Name an item, for the message that stops a training."""
        return f"item {item}"

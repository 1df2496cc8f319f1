"""What the training loop trains: a network, its items and its loss."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor, nn


class Learner(ABC):
    """A network with its training items and its validation.

    Attributes
    ----------
    module
        The network. The loop replaces it by a wrapper when training begins, hence the loss calls `self.module`.
    """

    def __init__(self, module: nn.Module) -> None:
        self.module = module

    @abstractmethod
    def __len__(self) -> int:
        """Count the training items per epoch."""

    @abstractmethod
    def loss(self, items: Sequence[int], generator: torch.Generator) -> Tensor:
        """Compute the training loss of some items: a scalar that depends on them, the module and the (CPU) generator alone."""

    @abstractmethod
    def validate(self) -> dict[str, float]:
        """Compute metrics on the validation split, deterministically; the least "loss" is the best epoch's."""

    def describe(self, item: int) -> str:
        """Name an item, for the message that stops a training."""
        return f"item {item}"

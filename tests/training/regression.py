"""A small learner with batch norm, randomness and a validation set: a line through noisy points."""

import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, distributed, nn

from pipeline.rng import seeded_weights
from pipeline.training.learner import Learner
from pipeline.training.loop import train
from pipeline.training.settings import TrainingSettings

Batch = tuple[list[int], Tensor]
"""Items, and the noise that is drawn for each."""


class Points(list[float]):
    """The items of a regression."""

    def name(self, item: int) -> str:
        return f"point-{item}"


class Regression(Learner):
    """y = 3 x + 1, with noise drawn for each item and epoch; `poison` is an item that is NaN.

    `kill_at` is a step at which the process dies, or of several processes the second.

    A `plain` one has neither noise nor batch norm: its gradient is the mean of its items'.
    """

    train: Points

    def __init__(self, kill_at: int | None = None, poison: int | None = None, seed: int = 0, plain: bool = False) -> None:
        with seeded_weights(seed, "regression"):
            norm = nn.Identity() if plain else nn.BatchNorm1d(8)
            network = nn.Sequential(nn.Linear(1, 8), norm, nn.ReLU(), nn.Linear(8, 1))
        super().__init__(network, Points(), Points(), None)
        self.noise = 0.0 if plain else 0.1
        self.x = torch.linspace(-1, 1, 48)[:, None]
        self.train.extend(self.x)
        self.steps, self.kill_at, self.poison = 0, kill_at, poison

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Batch:
        return list(items), torch.stack([torch.randn(1, generator=generator, dtype=torch.float32) for generator in generators])

    def loss(self, network: nn.Module, batch: Batch) -> Tensor:
        if self.steps == self.kill_at and (not distributed.is_initialized() or distributed.get_rank() == 1):
            os.kill(os.getpid(), signal.SIGKILL)
        self.steps += 1
        items, drawn = batch
        x = self.x[items].to(next(network.parameters()))
        noise = self.noise * drawn.to(x)
        if self.poison in items:
            noise = noise * torch.nan
        return (network(x) - 3 * x - 1 - noise).square().mean()

    def validate(self, network: nn.Module) -> dict[str, float]:
        x = self.x.to(next(network.parameters()))
        return {"loss": float((network(x) - 3 * x - 1).square().mean())}


class Scripted(Regression):
    """Learner with prescribed losses per epoch, whatever its weights are."""

    def __init__(self, training: Sequence[float] = (), validation: Sequence[float] = ()) -> None:
        super().__init__(plain=True)
        self.training, self.validation, self.validated = training, validation, 0

    def loss(self, network: nn.Module, batch: Batch) -> Tensor:
        told = self.training[self.validated] if self.training else 1.0
        return 0 * super().loss(network, batch) + told

    def validate(self, network: nn.Module) -> dict[str, float]:
        self.validated += 1
        return {"loss": self.validation[self.validated - 1] if self.validation else 1.0}


def fit(learner: Learner, folder: Path, seed: int = 0, **changes: Any) -> dict[str, Any]:
    """Train in a folder; the facts."""
    folder.mkdir(parents=True, exist_ok=True)
    return train(learner, settings(**changes), folder=folder, seed=seed, name="regression")


def settings(**changes: Any) -> TrainingSettings:
    values = {"learning_rate": 0.01, "batch_size": 8, "epochs": 5, "threads": 1, "checkpoint_seconds": 0, "accelerator": "cpu"}
    return TrainingSettings.model_validate(values | changes)


def run(folder: Path, seed: int = 0, kill_at: int | None = None, precision: str = "32-true") -> dict[str, Tensor]:
    """Train, or die at a step; the final weights."""
    learner = Regression(kill_at=kill_at, seed=seed)
    fit(learner, folder, seed, precision=precision, schedule="cosine", gradient_limit=1.0)
    return learner.network.state_dict()

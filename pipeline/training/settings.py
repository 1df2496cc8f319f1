"""The settings that every training has."""

from __future__ import annotations

from typing import Literal

from pipeline.config.settings import Settings, setting
from pipeline.training.schedule import Schedule


class TrainingSettings(Settings):
    """How a network is trained; what a stage trains derives its settings from these."""

    learning_rate: float = setting(1e-4, "Adam's", gt=0)
    schedule: Schedule = setting(
        "constant", "cosine: the rate rises over the first twentieth of all steps, then falls to 0 along half a cosine"
    )
    gradient_limit: float | None = setting(None, "norm to which a longer gradient is shortened before each step; null leaves it", gt=0)
    batch_size: int = setting(16, "items a step", ge=1)
    epochs: int = setting(100, "at most", ge=1)
    patience: int | None = setting(None, "epochs without a better validation loss after which training stops; null never does", ge=1)
    explosion: float = setting(
        1e4,
        "a loss above the first epoch's mean by this factor stops the training: no later epoch mends it",
        gt=1,
        changes="definition",
    )
    devices: int = setting(1, "processes per node that share a batch: the losses of one process, but for rounding", ge=1)
    num_nodes: int = setting(1, "nodes; more than one are started with torchrun or srun", ge=1)
    precision: Literal["32-true", "bf16-mixed", "64-true"] = setting(
        "32-true", "bf16-mixed pays on GPUs, and on CPUs with such instructions"
    )
    threads: int = setting(
        1, "of torch on a CPU: trainings side by side use cores better than threads; sums differ in their last bit", ge=1
    )
    accelerator: Literal["auto", "cpu", "cuda"] = setting("auto", "a GPU where there is one; the same to the last bits", changes="speed")
    checkpoint_seconds: float = setting(
        120.0, "between checkpoints within an epoch: what a killed run loses at most", ge=0, changes="speed"
    )

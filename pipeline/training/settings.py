"""The knobs that every training has."""

from __future__ import annotations

from typing import Literal

from pipeline.config.settings import Settings, knob


class TrainingSettings(Settings):
    """How a network is trained; what a stage trains derives its settings from these."""

    learning_rate: float = knob(1e-4, "Adam's", gt=0)
    batch_size: int = knob(16, "items a step", ge=1)
    epochs: int = knob(100, "at most", ge=1)
    patience: int | None = knob(None, "epochs without a better validation loss after which training stops; null never does", ge=1)
    explosion: float = knob(
        1e4, "a loss so many times the first epoch's mean stops the training: no later epoch mends it", gt=1, changes="definition"
    )
    devices: int = knob(1, "processes that share a batch; batch norm then sees a part each", ge=1)
    precision: Literal["32-true", "bf16-mixed", "64-true"] = knob("32-true", "bf16-mixed pays on GPUs, and on CPUs with such instructions")
    threads: int = knob(1, "of torch on a CPU: trainings side by side use cores better than threads; sums differ in their last bit", ge=1)
    accelerator: Literal["auto", "cpu", "cuda"] = knob("auto", "a GPU where there is one; the same to the last bits", changes="speed")
    checkpoint_seconds: float = knob(120.0, "between checkpoints within an epoch: what a killed run loses at most", ge=0, changes="speed")

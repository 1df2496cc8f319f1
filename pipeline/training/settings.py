"""The settings that every training has."""

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from pipeline.config.settings import Settings, defining, setting
from pipeline.errors import unknown_name
from pipeline.kernels.networks.network_configurations import NetworkInputs

Schedule = Literal["constant", "cosine"]
WARM_UP = 0.05
"""Share of all steps in which a cosine schedule rises to the full rate, while Adam has seen few gradients."""


class TrainingSettings(Settings):
    """The settings of a training, from which stages that train derive theirs."""

    learning_rate: float = setting(1e-4, "Adam's", gt=0, le=100)
    schedule: Schedule = setting(
        "constant", "cosine: the rate rises over the first twentieth of all steps, then falls to 0 along half a cosine"
    )
    gradient_limit: float | None = setting(None, "norm to which a longer gradient is shortened before each step; null leaves it", gt=0)
    image_gain: float = setting(
        0.0, "an item's image has each of its colours scaled by a factor within 1 ± this, drawn for each item", ge=0, lt=1
    )
    image_shift: float = setting(0.0, "levels, of 255, within which each colour of an item's image is shifted, likewise", ge=0, le=255)
    image_noise: float = setting(0.0, "standard deviation of noise of each pixel of an item's image, levels, likewise", ge=0, le=255)
    batch_size: int = setting(16, "items per step", ge=1)
    epochs: int = setting(100, "at most", ge=1)
    patience: int | None = setting(None, "epochs without a better validation loss after which training stops; null never does", ge=1)
    devices: int = setting(1, "processes on this machine that share a batch: the losses of one process, but for rounding", ge=1)
    precision: Literal["32-true", "bf16-mixed", "64-true"] = setting(
        "32-true",
        "bf16-mixed computes layers in bfloat16: a U-Net of width 64 takes 0.6 of the time on a CPU that knows it, small networks as long",
    )
    threads: int = setting(
        1, "of torch on a CPU: trainings side by side use cores better than threads; sums differ in their last bit", ge=1
    )
    accelerator: Literal["auto", "cpu", "cuda"] = setting(
        "auto", "a GPU where there is one; it rounds otherwise, as another processor does", changes="speed"
    )
    cache_megabytes: float = setting(
        256.0,
        "of decoded data that each split keeps in memory; where all of it fits, a GPU need not wait for what is read again in each epoch",
        ge=0,
        changes="speed",
    )
    checkpoint_seconds: float = setting(
        120.0, "between checkpoints within an epoch: what a killed run loses at most", ge=0, changes="speed"
    )

    def rate_at(self, step: int, steps: int) -> float:
        """Compute the learning rate at a step, which counts from 0: a resumed training has the same ones."""
        if self.schedule == "constant":
            return self.learning_rate
        rising = max(1, round(WARM_UP * steps))
        if step < rising:
            return self.learning_rate * ((step + 1) / rising)
        return self.learning_rate * ((1 + math.cos(math.pi * (step - rising) / max(1, steps - rising))) / 2)


class ReconstructionSettings(TrainingSettings):
    """The settings of the training of any network that reconstructs objects, with the definition of an item."""

    configurations: ClassVar[Mapping[str, NetworkInputs]]  # the family's networks by name

    configuration: str = defining(..., "which network")
    training_seed: int = defining(
        0, "another seed trains the same network with other random draws, into its own folder below models/seed-1 and so on", ge=0
    )
    pretrained: str | None = setting(
        None,
        "models to begin with the weights of, such as DATA/models, or `shipped`: the network of this configuration there, of the same "
        "sizes; null draws the first weights",
        min_length=1,
    )
    min_grasps: int = setting(1, "fewest grasps an item is given; how many, between fewest and most, is drawn for every item", ge=1)
    max_grasps: int = setting(5, "most grasps", ge=1)
    dropped_touches: float | None = setting(0.0, "share of an item's touch charts that is skipped, drawn for each item", ge=0, lt=1)
    samples_per_object: int = setting(
        5, "items per object and epoch, each beginning with another grasp (a drawn one, if fewer), with or without touch as input", ge=1
    )
    validation_items: int = setting(5, "items per validation object, with 1, 2, … grasps", ge=1)

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.min_grasps > self.max_grasps:
            raise ValueError(f"min_grasps is {self.min_grasps}, max_grasps {self.max_grasps}; the fewest cannot be more than the most")
        if self.configuration not in self.configurations:
            raise ValueError(unknown_name("configuration", self.configuration, self.configurations))
        return self

    @property
    def inputs(self) -> NetworkInputs:
        """Look up the configuration: the inputs of its network."""
        return self.configurations[self.configuration]

    def network(self, side: int) -> NetworkInputs:
        """Describe the network of these settings, for touch charts of side x side vertices."""
        sizes = self.model_dump(include=set(type(self.inputs).model_fields), exclude_none=True)
        return self.inputs.model_copy(update=sizes | {"side": side})

    @property
    def touch_dropout(self) -> float:
        """The share of touch charts that is skipped."""
        return self.dropped_touches or 0.0

    @property
    def dropped_inputs(self) -> tuple[float, float]:
        """The shares of items without image, and without touches, of a network that takes any inputs."""
        return 0.0, 0.0

"""The settings of `train-single-image`."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from pipeline.config.settings import setting
from pipeline.kernels.networks.network_configurations import SINGLE_IMAGE, NetworkConfig
from stages.train_gcn.settings import GcnSettings


class SingleImageSettings(GcnSettings):
    """How vision charts learn to become the object of one rendering (supplement 3.6): as `train-gcn`'s, but for these."""

    configuration: Literal["table-11"] = setting("table-11", "the network there is", changes="definition")
    encoder_layers: Literal[12, 15, 18, 25] | None = setting(None, "the table's 25; the others are for images of 256 pixels")
    encoder_linear: int | None = setting(None, "features that the pooled ones become; null is the table's 250", ge=1)
    learning_rate: float = setting(3e-3, "for trainings of minutes; the supplement has 1e-5, for three days", gt=0)
    batch_size: int = setting(4, "more steps in the time; the supplement has 64", ge=1)
    epochs: int = setting(30, "minutes on a CPU; the supplement has at most 40, of more objects and all views", ge=1)
    patience: int | None = setting(None, "the supplement names none", ge=1)
    training_seed: Literal[0] = setting(0, "there is one training", changes="definition")
    min_grasps: Literal[1] = setting(1, "one image")
    max_grasps: Literal[1] = setting(1, "one image")
    items: int = setting(5, "views per object and epoch, others in each epoch where they are fewer than all 24", ge=1)
    validation_items: int = setting(5, "views per validation object, the first ones", ge=1)

    @model_validator(mode="after")
    def _possible(self) -> SingleImageSettings:  # of `train-gcn`'s choices there is one
        return self

    @property
    def named(self) -> NetworkConfig:
        """Give the network of Table 11."""
        return SINGLE_IMAGE

"""The settings of `train-unet`."""

from typing import Literal

from pipeline.config.settings import setting
from pipeline.kernels.networks.unet import THRESHOLD
from pipeline.kernels.tensor_checks import COLOURS
from pipeline.training.settings import Schedule, TrainingSettings


class UnetSettings(TrainingSettings):
    """How the network that reads touches is trained (supplement 2.1 and 2.2, Table 5)."""

    learning_rate: float = setting(
        2e-3, "forty times the supplement's, for networks sixteen times smaller and trainings of minutes", gt=0, le=100
    )
    schedule: Schedule = setting("cosine", "rises, then falls to 0: depths are a sixth nearer (RMS) than at a constant rate of 1e-3")
    batch_size: int = setting(8, "more steps in the same time than the supplement's 32", ge=1)
    epochs: int = setting(30, "the supplement has at most 114", ge=1)
    width: int = setting(
        16, "features of the first level; 64 is Table 5, 24,425,601 parameters, and each halving four times fewer", ge=1, le=2**12
    )
    loss: Literal["depth", "chamfer"] = setting(
        "depth",
        "after equal time its depths are 13-20 % nearer (RMS) than those of `chamfer`, whose clouds are 1-9 % nearer; it costs 0.04 % of "
        "a step of width 64, `chamfer` 4 %",
    )
    mask_threshold: float = setting(
        THRESHOLD, "supplement 2.2: squared difference from the untouched tactile image beyond which a pixel has touched", ge=0, le=COLOURS
    )

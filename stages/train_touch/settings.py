"""The settings of `train-touch`."""

from typing import Literal

from pipeline.config.settings import setting
from pipeline.training.settings import Schedule, TrainingSettings


class TouchTrainingSettings(TrainingSettings):
    """How the local network that reads photographs is trained on simulated presses."""

    learning_rate: float = setting(4e-3, "for a small network and a thousand steps", gt=0, le=100)
    schedule: Schedule = setting("cosine", "a training of fixed length ends with small steps")
    epochs: int = setting(
        11,
        "with 1,800 presses, 1,200 steps; all are taken: the error on simulated presses does not tell when to stop for photographs",
        ge=1,
    )
    patience: Literal[None] = setting(None, "the last epoch is kept, whatever its validation loss")
    width: int = setting(20, "features of the hidden layers: 6,500 parameters", ge=1, le=2**12)
    window: int = setting(64, "pixels per side of the part of a press that a step sees; it costs a sixth of whole images of 160", ge=16)
    image_gain: float = setting(
        0.07,
        "exposure and lamps differ between days: each colour's change is scaled by a factor within 1 ± this, and 1.5 times this in common",
        ge=0,
        lt=1,
    )
    image_noise: float = setting(
        1.0, "greatest standard deviation of pixel noise, levels; what photographs of 160 pixels have", ge=0, le=255
    )
    image_mix: float = setting(0.05, "share of each colour that shows in another at most: lamps and filters overlap", ge=0, lt=1)
    image_depth: float = setting(
        5.0, "standard deviation of light that grows with depth, levels per mm: less than contacts of one sensor differ", ge=0, le=255
    )
    image_blur: float = setting(0.8, "greatest standard deviation of blur, pixels: of lens, gel and camera", ge=0, le=10)
    image_drift: float = setting(
        6.0,
        "greatest standard deviation by which a photograph's light differs smoothly from the untouched one's, levels; much more hides the "
        "gel around a contact",
        ge=0,
        le=255,
    )

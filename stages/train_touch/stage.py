"""`train-touch`: a local network learns to read depth and contact in photographs, from simulated presses."""

from typing import Any, Literal

from pipeline.config.settings import setting
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.training.settings import Schedule, TrainingSettings
from schemas.base import Artifact
from schemas.presses import PRESSES


class TouchTrainingSettings(TrainingSettings):
    """How the local network that reads photographs is trained on simulated presses."""

    learning_rate: float = setting(4e-3, "for a small network and a thousand steps", gt=0, le=100)
    schedule: Schedule = setting("cosine", "a training of fixed length ends with small steps")
    epochs: int = setting(
        11,
        "with 1,800 presses, 1,200 steps; the last is kept: the error on simulated presses does not tell when to stop for photographs",
        ge=1,
    )
    patience: Literal[None] = setting(None, "the last epoch is kept")
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


class TrainTouch(DatasetStage):
    """Train a small network that reads the gel's depth and contact from changes of colour."""

    name = "train-touch"
    summary = "A local network that reads depth and contact in photographs of a sensor, from simulated presses."
    settings_type = TouchTrainingSettings
    trains = True

    def inputs(self, settings: TouchTrainingSettings) -> tuple[Artifact, ...]:
        return (PRESSES,)

    def splits(self, settings: TouchTrainingSettings) -> tuple[str, ...]:
        return ("train", "valid")

    def writes(self, settings: TouchTrainingSettings) -> str:
        return "models/touch"

    def cost(self, settings: TouchTrainingSettings, objects: int) -> Cost:
        """Estimate 72 presses per object and epoch; a window's time grows with its pixels and with the width."""
        pixels = (settings.window / 64) ** 2
        return Cost(seconds=objects * 72 * settings.epochs * 0.003 * pixels * settings.width / 16, kilobytes=100)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and save the last epoch's weights with the sensor and its untouched image."""
        from pipeline.models.touch_model import save_touch_model
        from stages.train_touch.learner import train_local_network
        from stages.train_touch.presses import stored_presses

        settings: TouchTrainingSettings = job.settings
        presses, valid = (stored_presses(job.data, split, cache_megabytes=settings.cache_megabytes) for split in ("train", "valid"))
        network, facts = train_local_network(presses, valid, settings, folder=job.folder, seed=job.seed)
        save_touch_model(job.folder, network, sensor=presses.sensor, untouched=presses.untouched)
        return facts | {"presses": {"train": len(presses), "valid": len(valid)}}

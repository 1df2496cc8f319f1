"""`train-touch`: a local network learns to read depth and contact in photographs, from simulated presses."""

from typing import Any

from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.models.touch_model import save_touch_model
from schemas.base import Artifact
from schemas.presses import PRESSES
from stages.train_touch.learner import train_local_network
from stages.train_touch.presses import StoredPresses
from stages.train_touch.settings import TouchTrainingSettings


class TrainTouch(DatasetStage):
    """Trains a small network that reads the gel's depth and contact from changes of colour."""

    name = "train-touch"
    summary = "A local network that reads depth and contact in photographs of a sensor, from simulated presses."
    settings_type = TouchTrainingSettings
    trains = True

    def inputs(self, settings: TouchTrainingSettings) -> tuple[Artifact, ...]:
        """Name the input: presses."""
        return (PRESSES,)

    def splits(self, settings: TouchTrainingSettings) -> tuple[str, ...]:
        """Name the splits: one to learn from, one to watch."""
        return ("train", "valid")

    def writes(self, settings: TouchTrainingSettings) -> str:
        """Name the folder of the model, below the data directory."""
        return "models/touch"

    def cost(self, settings: TouchTrainingSettings, objects: int) -> Cost:
        """Estimate 72 presses per object and epoch; a window's time grows with its pixels and with the width."""
        pixels = (settings.window / 64) ** 2
        return Cost(seconds=objects * 72 * settings.epochs * 0.003 * pixels * settings.width / 16, kilobytes=100)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and save the last epoch's weights with the sensor and its untouched image."""
        settings: TouchTrainingSettings = job.settings
        presses, valid = (StoredPresses(job.data, split, cache_megabytes=job.settings.cache_megabytes) for split in ("train", "valid"))
        network, facts = train_local_network(presses, valid, settings, folder=job.folder, seed=job.seed)
        save_touch_model(job.folder, network, sensor=presses.sensor, untouched=presses.untouched)
        return facts | {"presses": {"train": len(presses), "valid": len(valid)}}

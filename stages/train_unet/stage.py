"""Supplement 2.1 and 2.2: a U-Net learns to see depth in tactile images."""

from typing import Any

from pipeline.engine.stage import Cost, DatasetJob, DatasetStage
from pipeline.errors import StageError
from pipeline.kernels.networks.unet import MIN_SIDE, UNet
from pipeline.models.touch_model import save_touch_model
from pipeline.rng import seeded_weights
from pipeline.training.loop import train
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from stages.train_unet.learner import UnetLearner, load_touches
from stages.train_unet.settings import UnetSettings


class TrainUnet(DatasetStage):
    """Trains a network that predicts depth from tactile images."""

    name = "train-unet"
    summary = "A U-Net that predicts each sensor's depth map from its tactile image."
    settings_type = UnetSettings
    trains = True

    def inputs(self, settings: UnetSettings) -> tuple[Artifact, ...]:
        """Name the inputs: tactile images, depths, and which sensors touched; no surface, no camera image."""
        return (TOUCH, GRASPS)

    def splits(self, settings: UnetSettings) -> tuple[str, ...]:
        """Name the splits: one to learn from, one to choose the best epoch by."""
        return ("train", "valid")

    def writes(self, settings: UnetSettings) -> str:
        """Name the folder of the model, below the data directory."""
        return "models/unet"

    def grid(self, settings: UnetSettings) -> dict[str, tuple[Any, ...]]:
        """Give the grid of supplement 2.2."""
        return {"learning_rate": (1e-3, 1e-4, 5e-5, 3e-5, 1e-5)}

    def cost(self, settings: UnetSettings, objects: int) -> Cost:
        """Estimate eighteen touches per object and epoch; a step costs the square of the width, and each pixel a constant."""
        share = (settings.width / 64) ** 2
        return Cost(seconds=objects * 18 * settings.epochs * (0.006 + 0.31 * share), kilobytes=98_000 * share + 10)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and save the best epoch's weights with their description: width, sensor, threshold, untouched tactile image."""
        settings: UnetSettings = job.settings
        touches, valid = (load_touches(job.data, split, cache_megabytes=job.settings.cache_megabytes) for split in ("train", "valid"))
        if min(touches.sensor.shape) < MIN_SIDE:
            rows, cols = touches.sensor.shape
            raise StageError(f"sensor {touches.sensor.name} has {rows} x {cols} pixels, the U-Net takes {MIN_SIDE} x {MIN_SIDE} or more")
        with seeded_weights(job.seed, self.name):
            network = UNet(settings.width)
        facts = train(UnetLearner(network, touches, valid, settings), settings, folder=job.folder, seed=job.seed, name=self.name)
        threshold = settings.mask_threshold
        save_touch_model(job.folder, network, sensor=touches.sensor, untouched=touches.untouched, mask_threshold=threshold)
        return facts | {"touches": {"train": len(touches), "valid": len(valid)}}

"""Supplement 2.1 and 2.2: a U-Net learns to see depth in tactile images."""

from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipeline.config.settings import setting
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage, Trade
from pipeline.errors import StageError
from pipeline.rng import seeded_weights
from pipeline.store.directory import DataDirectory
from pipeline.training.settings import Schedule, TrainingSettings
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.touch import TOUCH


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
        1e-3, "supplement 2.2: squared difference from the untouched tactile image beyond which a pixel has touched", ge=0, le=3
    )


class TrainUnet(DatasetStage):
    """Train a network that predicts depth from tactile images."""

    name = "train-unet"
    summary = "A U-Net that predicts each sensor's depth map from its tactile image."
    settings_type = UnetSettings
    trains = True

    def inputs(self, settings: UnetSettings) -> tuple[Artifact, ...]:
        return (TOUCH, GRASPS)

    def splits(self, settings: UnetSettings) -> tuple[str, ...]:
        return ("train", "valid")

    def writes(self, settings: UnetSettings) -> str:
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
        from pipeline.kernels.networks.unet import MIN_SIDE, UNet
        from pipeline.models.touch_model import save_touch_model
        from pipeline.training.loop import train
        from stages.train_unet.learner import UnetLearner, load_touches

        settings: UnetSettings = job.settings
        touches, valid = (load_touches(job.data, split, cache_megabytes=settings.cache_megabytes) for split in ("train", "valid"))
        if min(touches.sensor.shape) < MIN_SIDE:
            rows, cols = touches.sensor.shape
            raise StageError(f"sensor {touches.sensor.name} has {rows} x {cols} pixels, the U-Net takes {MIN_SIDE} x {MIN_SIDE} or more")
        with seeded_weights(job.seed, self.name):
            network = UNet(settings.width)
        facts = train(UnetLearner(network, touches, valid, settings), settings, folder=job.folder, seed=job.seed, name=self.name)
        threshold = settings.mask_threshold
        save_touch_model(job.folder, network, sensor=touches.sensor, untouched=touches.untouched, mask_threshold=threshold)
        return facts | {"touches": {"train": len(touches), "valid": len(valid)}}


def depth_errors(data: Path, reference: Path) -> dict[str, float]:
    """Compare predicted depths with the true ones where the sensors of test objects touch: RMS by object, um."""
    from pipeline.kernels.touch.depth_maps import in_gel
    from pipeline.models.touch_model import load_touch_model
    from stages.train_unet.learner import load_touches

    touches = load_touches(data, "test")
    model = load_touch_model(DataDirectory(data).verified_folder("models/unet"), "cpu")
    tactile_images, depth = (tensor.numpy() for tensor in touches.read(range(len(touches))))
    contact = in_gel(depth, touches.sensor)
    squares = np.where(contact, (model.maps(tactile_images)[0] - depth).astype(np.float64), 0.0) ** 2
    rows_by_object = {touches.rows.object_ids[number]: touches.where[:, 0] == number for number in np.unique(touches.where[:, 0])}
    return {name: 1e6 * float(np.sqrt(squares[rows].sum() / contact[rows].sum())) for name, rows in rows_by_object.items()}


TRADE = Trade(
    metric="depth predicted for test objects, RMS",
    unit="um",
    candidates=({"epochs": 5}, {"epochs": 20}, {"width": 4}, {"width": 16, "epochs": 20}),
    errors=depth_errors,
)

"""`train-unet`: a U-Net learns to see depth in tactile images (supplement 2.1 and 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pipeline.config.settings import setting
from pipeline.dataset.object_rows import CACHE_MEGABYTES, ObjectRows
from pipeline.engine.stage import Cost, DatasetJob, Trade
from pipeline.errors import StageError
from pipeline.kernels.touch.depth_maps import gel_surface, gel_top, in_gel
from pipeline.kernels.touch.sensor import Sensor
from pipeline.rng import seeded_weights
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from pipeline.training.learner import Learner
from pipeline.training.settings import Schedule, TrainingSettings
from pipeline.training.training_stage import Training
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.touch import TOUCH

if TYPE_CHECKING:
    import torch
    from torch import Tensor, nn

ARRAYS = ("tactile_image", "depth", "untouched", "touch_success")  # arrays that are read of each object
MICROMETRES = 1e6


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


@dataclass(frozen=True)
class Touches:
    """Hold the touches of a split."""

    rows: ObjectRows  # per grasp `tactile_image` (sensor, H, W, 3) uint8, `depth` (sensor, H, W) float32, m
    where: np.ndarray  # (N, 3) int64: object, grasp and sensor of each touch
    sensor: Sensor
    untouched: np.ndarray  # (H, W, 3) uint8 tactile image without a touch

    def __len__(self) -> int:
        return len(self.where)

    def name(self, item: int) -> str:
        """Name the object, grasp and sensor of a touch."""
        number, grasp, sensor = self.where[item]
        return f"{self.rows.object_ids[number]} grasp {grasp} sensor {sensor}"

    def read(self, items: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Read tactile images (B, H, W, 3) uint8 and depths (B, H, W) float32, m."""
        sites = [(self.rows.object_ids[number], grasp, sensor) for number, grasp, sensor in self.where[list(items)].tolist()]
        images, depths = (
            np.stack([self.rows.read(array, object_id, grasp)[sensor] for object_id, grasp, sensor in sites])
            for array in ("tactile_image", "depth")
        )
        return images, depths


def load_touches(data: Location, split: str, *, cache_megabytes: float = CACHE_MEGABYTES) -> Touches:
    """List the touches among a split's sensors; at most `cache_megabytes` of them stay in memory."""
    rows = ObjectRows(data, ARRAYS, split, cache_megabytes=cache_megabytes)
    success = np.stack([rows.read("touch_success", object_id) for object_id in rows.object_ids])  # (object, grasp, sensor)
    if not success.any():
        raise StageError(
            f"none of the {success.size} sensors of split {split} ({len(rows)} objects) touches; "
            "use more objects, or more simulate-grasps.attempts"
        )
    return Touches(rows, np.argwhere(success), rows.sensor(), rows.read("untouched", rows.object_ids[0])[0])


class UnetLearner(Learner):
    """A U-Net with its touches."""

    train: Touches
    valid: Touches

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Read training touches: tactile images (B, H, W, 3), depths (B, H, W), m, and the images, varied."""
        from pipeline.training.items import vary_image

        images, depths = self.train.read(items)
        return images, depths, np.stack([vary_image(image, self.settings, rng) for image, rng in zip(images, generators, strict=True)])

    def loss(self, network: nn.Module, batch: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Tensor:
        """Compute the chosen loss of some training touches, in sensor widths squared."""
        return self._compare(network, *batch)[0]

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Compute the chosen loss over the validation touches, and the RMS error of all their masked pixels, µm."""
        loss = squares = pixels = 0.0
        for items in self.validation_batches():
            images, depths = self.valid.read(items)
            mean, error = self._compare(network, images, depths, images)
            loss += len(items) * float(mean)
            squares += float(error.square().sum())
            pixels += len(error)
        rms = (squares / max(pixels, 1)) ** 0.5
        return {"loss": loss / len(self.valid), "depth_rms_um": rms * MICROMETRES}

    def _compare(self, network: nn.Module, images: np.ndarray, depths: np.ndarray, varied: np.ndarray) -> tuple[Tensor, Tensor]:
        """Predict depth from `varied` images: the chosen loss, and the errors at the masked pixels of `images`, float64, m."""
        import torch

        from pipeline.kernels.networks.unet import contact_mask, masked_depth_loss, projected_chamfer_loss, visible_depth
        from pipeline.kernels.tensors import network_input

        sensor, parameter = self.train.sensor, next(network.parameters())
        tactile_images, untouched, inputs = (
            torch.tensor(array, device=parameter.device) for array in (images, self.train.untouched, varied)
        )
        mask = contact_mask(tactile_images, untouched, self.settings.mask_threshold)
        predicted = network(network_input(inputs, parameter.dtype)) * gel_top(sensor)
        depth, gel = torch.from_numpy(depths).to(parameter), torch.tensor(gel_surface(sensor))
        if self.settings.loss == "depth":
            loss = masked_depth_loss(predicted, depth, mask, width=sensor.width, gel=gel)
        else:
            loss = projected_chamfer_loss(predicted, depth, mask, width=sensor.width, gel=gel, aspect=sensor.aspect)
        return loss, (predicted - visible_depth(depth, gel)).detach()[mask].double()


class TrainUnet(Training):
    """Train a network that predicts depth from tactile images."""

    name = "train-unet"
    summary = "A U-Net that predicts each sensor's depth map from its tactile image."
    settings_type = UnetSettings

    def inputs(self, settings: UnetSettings) -> tuple[Artifact, ...]:
        return (TOUCH, GRASPS)

    def writes(self, settings: UnetSettings) -> str:
        return "models/unet"

    def grid(self, settings: UnetSettings) -> dict[str, tuple[Any, ...]]:
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
    from pipeline.models.touch_model import load_touch_model

    touches = load_touches(data, "test")
    model = load_touch_model(DataDirectory(data).verified_folder("models/unet"), "cpu")
    tactile_images, depth = touches.read(range(len(touches)))
    contact = in_gel(depth, touches.sensor)
    squares = np.where(contact, (model.maps(tactile_images)[0] - depth).astype(np.float64), 0.0) ** 2
    rows_by_object = {touches.rows.object_ids[number]: touches.where[:, 0] == number for number in np.unique(touches.where[:, 0])}
    return {name: MICROMETRES * float(np.sqrt(squares[rows].sum() / contact[rows].sum())) for name, rows in rows_by_object.items()}


TRADE = Trade(
    metric="depth predicted for test objects, RMS",
    unit="um",
    candidates=({"epochs": 5}, {"epochs": 20}, {"width": 4}, {"width": 16, "epochs": 20}),
    errors=depth_errors,
)

"""Training data of `train-unet`: the tactile images of sensors that touched, and the depths behind them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from pipeline.dataset.object_rows import CACHE_MEGABYTES, ObjectRows
from pipeline.errors import StageError
from pipeline.kernels.networks.unet import UNet, contact_mask, masked_depth_loss, projected_chamfer_loss, visible_depth
from pipeline.kernels.tensors import network_input
from pipeline.kernels.touch.depth_maps import gel_surface, gel_top
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.storage import Location
from pipeline.training.augmentation import vary_image
from pipeline.training.learner import Learner
from stages.train_unet.stage import UnetSettings

ARRAYS = ("tactile_image", "depth", "untouched", "touch_success")
"""Arrays that are read of each object."""
MICROMETRES = 1e6


@dataclass(frozen=True)
class Touches:
    """Hold the touches of a split."""

    rows: ObjectRows  # per grasp `tactile_image` (sensor, H, W, 3) uint8, `depth` (sensor, H, W) float32, m
    where: np.ndarray  # (N, 3) int64: object, grasp and sensor of each touch
    sensor: Sensor
    untouched: np.ndarray  # (H, W, 3) uint8 tactile image without a touch

    def __len__(self) -> int:
        return len(self.where)

    def read(self, items: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Read tactile images (B, H, W, 3) uint8 and depths (B, H, W) float32, m."""
        sites = [(self.rows.object_ids[number], grasp, sensor) for number, grasp, sensor in self.where[list(items)].tolist()]
        images, depths = (
            torch.from_numpy(np.stack([self.rows.read(array, object_id, grasp)[sensor] for object_id, grasp, sensor in sites]))
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
    sensor = rows.sensor()
    return Touches(rows, np.argwhere(success), sensor, rows.read("untouched", rows.object_ids[0])[0])


class UnetLearner(Learner):
    """A U-Net with its touches."""

    def __init__(self, network: UNet, train: Touches, valid: Touches, settings: UnetSettings) -> None:
        super().__init__(network)
        self.train, self.valid, self.settings = train, valid, settings
        self.gel = torch.tensor(gel_surface(train.sensor))  # m; () where it is flat, else (H, W)

    def __len__(self) -> int:
        return len(self.train)

    def describe(self, item: int) -> str:
        """Name the object, grasp and sensor of a training item."""
        number, grasp, sensor = self.train.where[item]
        return f"{self.train.rows.object_ids[number]} grasp {grasp} sensor {sensor}"

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> tuple[Tensor, Tensor, Tensor]:
        """Read training touches: tactile images (B, H, W, 3), depths (B, H, W), m, and the images, varied."""
        tactile_images, depth = self.train.read(items)
        pairs = zip(tactile_images.numpy(), generators, strict=True)
        return tactile_images, depth, torch.from_numpy(np.stack([vary_image(image, self.settings, rng) for image, rng in pairs]))

    def loss(self, network: nn.Module, batch: tuple[Tensor, Tensor, Tensor]) -> Tensor:
        """Compute the chosen loss of some training touches, in sensor widths squared."""
        return self._loss(*self._predict(network, *batch))

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Compute the chosen loss over the validation touches, and the RMS error of all their masked pixels, µm."""
        loss = squares = pixels = 0.0
        for start in range(0, len(self.valid), self.settings.batch_size):
            items = range(len(self.valid))[start : start + self.settings.batch_size]
            tactile_images, depths = self.valid.read(items)
            predicted, depth, mask = self._predict(network, tactile_images, depths, tactile_images)
            loss += len(items) * float(self._loss(predicted, depth, mask))
            error = (predicted - visible_depth(depth, self.gel))[mask].double()
            squares += float(error.square().sum())
            pixels += len(error)
        rms = (squares / max(pixels, 1)) ** 0.5
        return {"loss": loss / len(self.valid), "depth_rms_um": rms * MICROMETRES}

    def _predict(self, network: nn.Module, tactile_images: Tensor, depth: Tensor, varied: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Predict depth from `varied` images: predicted and true (B, H, W), m, and the mask (B, H, W) of `tactile_images`."""
        parameter = next(network.parameters())
        tactile_images, untouched = tactile_images.to(parameter.device), torch.tensor(self.train.untouched, device=parameter.device)
        mask = contact_mask(tactile_images, untouched, self.settings.mask_threshold)
        inputs = network_input(varied.to(parameter.device), parameter.dtype)
        return network(inputs) * gel_top(self.train.sensor), depth.to(parameter), mask

    def _loss(
        self,
        predicted: Tensor,  # (B, H, W) m
        depth: Tensor,  # (B, H, W) m
        mask: Tensor,  # (B, H, W)
    ) -> Tensor:
        sensor = self.train.sensor
        if self.settings.loss == "depth":
            return masked_depth_loss(predicted, depth, mask, width=sensor.width, gel=self.gel)
        return projected_chamfer_loss(predicted, depth, mask, width=sensor.width, gel=self.gel, aspect=sensor.aspect)

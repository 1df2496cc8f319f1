"""A trained U-Net as its users want it: tactile readings in, depths and local point clouds out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import StoreError
from pipeline.kernels.networks.contact_mask import contact_mask
from pipeline.kernels.networks.images import network_input
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.models.model_files import load_model, save_model

UNTOUCHED = "untouched.png"
BATCH = 32
"""Readings at a time: at Table 5's width about half a GB of features."""


def save_touch_model(folder: Path, network: UNet, sensor: Sensor, untouched: np.ndarray, mask_threshold: float) -> None:
    """Write a trained U-Net with what its users need: the sensor, its (H, W, 3) uint8 untouched reading, the mask's threshold."""
    Image.fromarray(untouched).save(folder / UNTOUCHED)  # PNG: lossless
    save_model(folder, network, {"width": network.width, "mask_threshold": mask_threshold, "sensor": sensor.model_dump(mode="json")})


def load_touch_model(folder: Path, device: torch.device | str) -> TouchModel:
    """The U-Net that `train-unet` left in `folder`, on a device; a `StoreError` where there is none."""
    weights, description = load_model(folder)
    try:
        network = UNet(description["width"])
        network.load_state_dict(weights)
        sensor = Sensor.model_validate(description["sensor"])
        with Image.open(folder / UNTOUCHED) as image:
            untouched = np.asarray(image)
        threshold = float(description["mask_threshold"])
    except (KeyError, RuntimeError, OSError, ValueError) as error:
        raise StoreError(f"{folder} holds no U-Net that can be used ({error}); run train-unet again") from error
    return TouchModel(network.to(device).eval(), sensor, untouched, threshold)


@dataclass(frozen=True)
class TouchModel:
    """A trained U-Net in evaluation mode.

    Attributes
    ----------
    sensor
        Whose readings it was trained on.
    untouched
        (H, W, 3) uint8, its reading of nothing.
    mask_threshold
        See `contact_mask`.
    """

    network: UNet
    sensor: Sensor
    untouched: NDArray[np.uint8]
    mask_threshold: float

    def depth(self, readings: np.ndarray) -> NDArray[np.float32]:
        """Predicted depth D from the sensor plane, (N, H, W) float32, m, of readings (N, H, W, 3) uint8; meant where `mask` holds."""
        self._check(readings)
        parameter = next(self.network.parameters())
        depth = np.empty(readings.shape[:3], np.float32)
        with torch.inference_mode():
            for start in range(0, len(readings), BATCH):
                batch = torch.tensor(readings[start : start + BATCH], device=parameter.device)
                share = self.network(network_input(batch, parameter.dtype))
                depth[start : start + BATCH] = (share * self.sensor.w).cpu().numpy()
        return depth

    def mask(self, readings: np.ndarray) -> NDArray[np.bool_]:
        """The pixels that touched, (N, H, W) bool, of readings (N, H, W, 3) uint8."""
        self._check(readings)
        mask = np.empty(readings.shape[:3], np.bool_)
        untouched = torch.tensor(self.untouched)
        for start in range(0, len(readings), BATCH):
            batch = torch.tensor(readings[start : start + BATCH])
            mask[start : start + BATCH] = contact_mask(batch, untouched, self.mask_threshold).numpy()
        return mask

    def clouds(self, readings: np.ndarray) -> list[NDArray[np.float64]]:
        """The local point cloud of each reading (N, H, W, 3) uint8: (n, 3) in the sensor's frame, m, row by row; n may be 0."""
        x, y = pixel_centres(self.sensor)
        clouds = []
        for depth, mask in zip(self.depth(readings), self.mask(readings), strict=True):
            row, col = np.nonzero(mask)
            clouds.append(np.stack([x[col], y[row], depth[row, col].astype(np.float64)], axis=1))
        return clouds

    def _check(self, readings: np.ndarray) -> None:
        if readings.ndim != 4 or readings.shape[1:] != self.untouched.shape or readings.dtype != np.uint8:
            raise ValueError(
                f"readings are {readings.dtype} {readings.shape}; this model was trained on sensor {self.sensor.name!r}: "
                f"uint8 (N, {', '.join(map(str, self.untouched.shape))})"
            )

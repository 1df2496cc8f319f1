"""Trained U-Nets: from tactile images to depth maps and local point clouds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field

from pipeline.errors import InvalidInput
from pipeline.formats.image_file import read_image
from pipeline.kernels.networks.contact_mask import contact_mask
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.tensor_checks import COLOURS, network_input
from pipeline.kernels.touch.sensor import Sensor, masked_points
from pipeline.models.model_files import load_network, read_description, save_model, unusable

UNTOUCHED = "untouched.png"
IMAGES_AT_ONCE = 32
"""Tactile images in one batch: at Table 5's width about half a GB of features."""


class _Description(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    width: int = Field(ge=1, le=2**12)
    mask_threshold: float = Field(ge=0, le=COLOURS)
    sensor: Sensor


def save_touch_model(folder: Path, network: UNet, *, sensor: Sensor, untouched: np.ndarray, mask_threshold: float) -> None:
    """Write a trained U-Net with all that its users need.

    Parameters
    ----------
    folder
        Existing.
    network
        The trained network.
    sensor, untouched
        The sensor of its tactile images, and the one without contact, (H, W, 3) uint8 sRGB.
    mask_threshold
        Difference of colours, 0 to 255, above which a pixel touches.
    """
    Image.fromarray(untouched).save(folder / UNTOUCHED)  # PNG: lossless
    save_model(folder, network, {"width": network.width, "mask_threshold": mask_threshold, "sensor": sensor.model_dump(mode="json")})


def load_touch_model(folder: Path, device: torch.device | str) -> TouchModel:
    """Load the U-Net that `train-unet` saved in `folder`; raise a `StoreError` if it is missing."""
    described = read_description(folder, _Description)
    network = load_network(folder, lambda: UNet(described.width), device)
    try:
        untouched = read_image(folder / UNTOUCHED)
    except InvalidInput as error:
        raise unusable(folder, error) from error
    if untouched.shape[:2] != described.sensor.shape:
        raise unusable(folder, f"{UNTOUCHED} has {untouched.shape[:2]} pixels, its sensor {described.sensor.shape}")
    return TouchModel(network, described.sensor, untouched, described.mask_threshold)


@dataclass(frozen=True)
class TouchModel:
    """A trained U-Net in evaluation mode.

    Attributes
    ----------
    network
        On the device where it computes.
    sensor
        Whose tactile images it was trained on.
    untouched
        (H, W, 3) uint8, that sensor's image with nothing on it.
    mask_threshold
        See `contact_mask`.
    """

    network: UNet
    sensor: Sensor
    untouched: NDArray[np.uint8]
    mask_threshold: float

    def depth(self, images: np.ndarray) -> NDArray[np.float32]:
        """Predict the depth D from the sensor plane.

        Parameters
        ----------
        images
            (N, H, W, 3) uint8 tactile images.

        Returns
        -------
        (N, H, W) float32, m; meant where `mask` holds.

        Raises
        ------
        InvalidInput
            The images are not this sensor's.
        """
        self._check(images)
        parameter = next(self.network.parameters())
        with torch.inference_mode():
            batches = torch.split(torch.tensor(images, device=parameter.device), IMAGES_AT_ONCE)
            share = torch.cat([self.network(network_input(batch, parameter.dtype)) for batch in batches])
            return (share * self.sensor.w).float().cpu().numpy()

    def mask(self, images: np.ndarray) -> NDArray[np.bool_]:
        """Find the pixels that touched, (N, H, W) bool; parameters and errors as `depth`."""
        self._check(images)
        return contact_mask(torch.tensor(images), torch.tensor(self.untouched), self.mask_threshold).numpy()

    def clouds(self, images: np.ndarray) -> list[NDArray[np.float64]]:
        """Predict the local point cloud of each image: (n, 3) sensor frame, m, row by row; n may be 0. Parameters and errors as `depth`."""
        return [masked_points(*maps, self.sensor) for maps in zip(self.depth(images), self.mask(images), strict=True)]

    def check_sensor(self, sensor: Sensor) -> None:
        """Raise `InvalidInput` where `sensor` is not the one of the tactile images that the U-Net was trained on."""
        if sensor != self.sensor:
            raise InvalidInput(
                f"the U-Net knows sensor {self.sensor.name}, the tactile images are {sensor.name}'s: run train-unet on these"
            )

    def _check(self, images: np.ndarray) -> None:
        if images.ndim != 4 or images.shape[1:] != self.untouched.shape or images.dtype != np.uint8:
            raise InvalidInput(
                f"tactile images are {images.dtype} {images.shape}; this model was trained on sensor {self.sensor.name!r}: "
                f"uint8 (N, {', '.join(map(str, self.untouched.shape))})"
            )

"""Trained networks that read tactile images: depth maps, contact and local point clouds."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from pydantic import Field, model_validator
from torch import Tensor, nn
from torch.nn.functional import interpolate

from pipeline.entries import Entries
from pipeline.errors import InvalidInput
from pipeline.formats.image_file import read_image
from pipeline.kernels.networks.local_network import LocalNetwork, pixel_positions, without_drift
from pipeline.kernels.networks.slope_integration import free_pressed_rim
from pipeline.kernels.networks.unet import UNet, contact_mask
from pipeline.kernels.tensors import COLOURS, network_input
from pipeline.kernels.touch.depth_maps import gel_surface, gel_top
from pipeline.kernels.touch.elastic_contact import PressedGel
from pipeline.kernels.touch.sensor import MM, Sensor, masked_points, resample, sensor_differences
from pipeline.kernels.touch.surface_contact import contact_margin
from pipeline.models.model_files import load_network, read_description, save_model, unusable
from pipeline.models.shipped_weights import shipped_sensor_network

UNTOUCHED = "untouched.png"
IMAGES_AT_ONCE = 32  # tactile images in one batch: at Table 5's width about half a GB of features
SIDES_TOLERANCE = 0.03
"""Largest relative difference between the aspect ratios of photographs and sensor: pixels may not be quite square."""
SAME_IMAGES = {"rows": True, "cols": True, "markers": True, "gel": {"modulus", "friction"}}
"""Entries that may differ from the sensor of a network that was not named: they change no indentation, nor images with dots filled in."""
MAY_DIFFER = dict.fromkeys(("rows", "cols", "range", "membrane", "gel", "markers", "noise"), True) | {"calibrated": {"background"}}
"""Entries that may differ from a local network's sensor: pixels, range, background, dots and noise, and how soft the gel is."""


class _Description(Entries):
    network: Literal["unet", "local"] = "unet"
    width: int = Field(ge=1, le=2**12)
    mask_threshold: float | None = Field(default=None, ge=0, le=COLOURS)
    sensor: Sensor

    @model_validator(mode="after")
    def _has_a_threshold(self) -> "_Description":
        if (self.network == "unet") == (self.mask_threshold is None):
            raise ValueError(f"mask_threshold is {self.mask_threshold}; a U-Net has one, and a local network finds contact itself")
        return self


def save_touch_model(
    folder: Path,  # exists
    network: UNet | LocalNetwork,
    *,
    sensor: Sensor,  # of its tactile images
    untouched: np.ndarray,  # (H, W, 3) uint8 sRGB, the image without contact
    mask_threshold: float | None = None,  # of a U-Net, see `contact_mask`
) -> None:
    """Write a trained network with its sensor and untouched image."""
    Image.fromarray(untouched).save(folder / UNTOUCHED)  # PNG: lossless
    kind: Literal["unet", "local"] = "local" if isinstance(network, LocalNetwork) else "unet"
    save_model(folder, network, _Description(network=kind, width=network.width, mask_threshold=mask_threshold, sensor=sensor))


def load_touch_model(folder: Path, device: torch.device | str) -> "TouchModel":
    """Load the network that `train-unet` or `train-touch` saved in `folder`; raise a `StoreError` if it is missing."""
    description = read_description(folder, _Description)
    try:
        untouched = read_image(folder / UNTOUCHED)
    except InvalidInput as error:
        raise unusable(folder, error) from error
    if untouched.shape[:2] != description.sensor.shape:
        raise unusable(folder, f"{UNTOUCHED} has {untouched.shape[:2]} pixels, its sensor {description.sensor.shape}")
    if description.mask_threshold is None:
        return LocalTouchModel(load_network(folder, lambda: LocalNetwork(description.width), device), description.sensor, untouched)
    unet = load_network(folder, lambda: UNet(description.width), device)
    return UnetTouchModel(unet, description.sensor, untouched, description.mask_threshold)


@lru_cache(maxsize=8)
def shipped_touch_model(sensor: Sensor, device: torch.device | str) -> "LocalTouchModel":
    """Load the pretrained network for a sensor's photographs; raise an `InvalidInput` if there is none."""
    remedy = "read them with `read-touch` and a network for it, and give NAME-depth.png and NAME-contact.png as depth and contact"
    folder = shipped_sensor_network(sensor.name)
    if folder is None:
        raise InvalidInput(f"no pretrained network reads photographs of sensor {sensor.name}: {remedy}")
    model = load_touch_model(folder, device)
    assert isinstance(model, LocalTouchModel)
    model.check_description(sensor, f"the pretrained network for {sensor.name}", f"the given {sensor.name}", remedy)
    return model


@dataclass(frozen=True)
class TouchModel(ABC):
    """A trained network in evaluation mode, on the device where it computes."""

    network: nn.Module
    sensor: Sensor  # whose tactile images it was trained on
    untouched: NDArray[np.uint8]  # (H, W, 3), that sensor's image with nothing on it
    stage: ClassVar[str]  # it trains such a network
    may_differ: ClassVar[Mapping[str, Any]] = {}  # entries that may differ from the sensor's, as pydantic's `exclude`

    @abstractmethod
    def maps(
        self,
        images: np.ndarray,  # (N, H, W, 3) uint8, of this sensor
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:  # (N, H, W) m; (N, H, W)
        """Predict the depth D from the sensor plane, meant at the pixels that touched, and which these are."""

    def clouds(self, images: np.ndarray) -> list[NDArray[np.float64]]:
        """Predict the local point cloud of each image: (n, 3) sensor frame, m, row by row; n may be 0."""
        depth, mask = self.maps(images)
        sensor = resample(self.sensor, *depth.shape[1:])
        return [masked_points(*maps, sensor) for maps in zip(depth, mask, strict=True)]

    def check_sensor(self, sensor: Sensor) -> None:
        """Raise an `InvalidInput` if the network was trained on another sensor's tactile images."""
        if differing := sensor_differences(self.sensor, sensor, but_for=self.may_differ):
            raise InvalidInput(
                f"the network knows sensor {self.sensor.name}, the tactile images are {sensor.name}'s, and {', '.join(differing)} differ: "
                f"run {self.stage} for it"
            )


@dataclass(frozen=True)
class UnetTouchModel(TouchModel):
    """The paper's U-Net, for images with its sensor's pixels; `mask_threshold` as in `contact_mask`."""

    network: UNet
    mask_threshold: float
    stage = "train-unet"

    def maps(self, images: np.ndarray) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Predict the depth D, and find the pixels whose colour differs from the untouched image's."""
        if images.ndim != 4 or images.shape[1:] != self.untouched.shape or images.dtype != np.uint8:
            raise InvalidInput(
                f"tactile images are {images.dtype} {images.shape}; this model was trained on sensor {self.sensor.name!r}: "
                f"uint8 (N, {', '.join(map(str, self.untouched.shape))})"
            )
        parameter = next(self.network.parameters())
        with torch.inference_mode():
            batches = torch.split(torch.tensor(images, device=parameter.device), IMAGES_AT_ONCE)
            share = torch.cat([self.network(network_input(batch, parameter.dtype)) for batch in batches])
            depth = (share * gel_top(self.sensor)).float().cpu().numpy()
        return depth, contact_mask(torch.tensor(images), torch.tensor(self.untouched), self.mask_threshold).numpy()


@dataclass(frozen=True)
class LocalTouchModel(TouchModel):
    """A local network, for images of its sensor with any number of pixels: they are resampled to those of its training."""

    network: LocalNetwork
    stage = "train-touch"
    may_differ = MAY_DIFFER

    def read(
        self,
        images: np.ndarray,  # (N, H, W, 3) uint8, of the sensor's aspect ratio
        untouched: np.ndarray | None = None,  # (H, W, 3) uint8, of the same day; by default the model's own
        pixel_aspect: float = 1.0,  # height over width of a pixel of the images
    ) -> PressedGel:  # with the images' pixels; indentation >= 0
        """Read the gel in photographs, whose light may have drifted since the untouched one."""
        if images.ndim != 4 or images.shape[3] != COLOURS or images.dtype != np.uint8:
            raise InvalidInput(f"tactile images are {images.dtype} {images.shape}; the local network reads uint8 (N, rows, cols, 3)")
        if untouched is not None and (untouched.shape != images.shape[1:] or untouched.dtype != np.uint8):
            raise InvalidInput(f"the untouched photograph is {untouched.dtype} {untouched.shape}, the others are {images.shape[1:]}")
        self.check_sides(images.shape[1], images.shape[2], pixel_aspect)
        parameter = next(self.network.parameters())
        position = pixel_positions(*self.sensor.shape).to(parameter)
        pitch = (MM * self.sensor.pitch[0], MM * self.sensor.pitch[1])
        batches = []
        with torch.inference_mode():
            untouched_levels = self._resized(self.untouched if untouched is None else untouched, parameter)
            for first in range(0, max(len(images), 1), IMAGES_AT_ONCE):  # an empty batch is read too
                change = without_drift(self._resized(images[first : first + IMAGES_AT_ONCE], parameter) - untouched_levels)
                shape = self.network(change, position, pitch)
                depth = (free_pressed_rim(shape.depth, shape.slopes, pitch).clamp(min=0) / MM).cpu()
                margins = [contact_margin(surface, self.sensor.pitch, self.sensor.layer_thickness) for surface in depth.double().numpy()]
                maps = torch.stack([depth, torch.tensor(np.array(margins)).reshape(depth.shape).to(depth)], dim=1)
                batches.append(interpolate(maps, size=images.shape[1:3], mode="bilinear"))
        indentation, margin = torch.cat(batches).unbind(dim=1)
        return PressedGel(indentation.float().numpy(), (margin > 0).numpy())

    def maps(self, images: np.ndarray) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Predict the depth D, of the gel at rest less its indentation, and find the contact."""
        reading = self.read(images)
        gel_at_rest = gel_surface(resample(self.sensor, *images.shape[1:3]))
        return np.maximum(gel_at_rest - reading.indentation, 0).astype(np.float32), reading.contact

    def check_description(self, sensor: Sensor, network: str, what: str, remedy: str) -> None:
        """Raise an `InvalidInput` if photographs of the sensor, as it is described, are not like those of the training."""
        if differing := sensor_differences(self.sensor, sensor, but_for=SAME_IMAGES):
            raise InvalidInput(f"{network} was trained for another sensor than {what}: {', '.join(differing)} differ; {remedy}")

    def _resized(self, images: np.ndarray, parameter: Tensor) -> Tensor:
        """Average (…, H, W, 3) images to the network's pixels: (B, 3, rows, cols), levels."""
        levels = (
            torch.tensor(np.ascontiguousarray(images), device=parameter.device)
            .reshape(-1, *images.shape[-3:])
            .permute(0, 3, 1, 2)
            .to(parameter.dtype)
        )
        return interpolate(levels, size=self.sensor.shape, mode="area")

    def check_sides(self, rows: int, cols: int, pixel_aspect: float = 1.0) -> None:
        """Raise an `InvalidInput` if the aspect ratio of images of this shape is not the sensor's."""
        aspect, expected = cols / rows / pixel_aspect, self.sensor.width / self.sensor.height
        if abs(aspect / expected - 1) > SIDES_TOLERANCE:
            raise InvalidInput(
                f"photographs of {rows} x {cols} pixels are {aspect:.3g} times as wide as high, sensor {self.sensor.name} is "
                f"{expected:.3g}: crop them to what the sensor file describes"
            )

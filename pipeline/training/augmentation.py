"""Random variation of training items: colours and sensors, against overfitting; the object's pose, which a robot estimates."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.geometry.transforms import scaling_about
from pipeline.kernels.vision.view_transfer import background_color, carried_camera, transfer_view
from pipeline.models.observation import Observation
from pipeline.training.settings import ReconstructionSettings, TrainingSettings


def vary_image(
    image: np.ndarray,  # (H, W, 3) uint8
    settings: TrainingSettings,  # `image_gain`, `image_shift` and `image_noise`
    generator: torch.Generator,
) -> np.ndarray:  # (H, W, 3) uint8
    """Scale and shift the colours of an image, and add noise to its pixels; all settings at 0 leave it unchanged."""
    if not (settings.image_gain or settings.image_shift or settings.image_noise):
        return image
    scale = 1 + settings.image_gain * _within_one(3, generator)
    levels = torch.tensor(image, dtype=torch.float32) * scale + settings.image_shift * _within_one(3, generator)
    if settings.image_noise:
        levels += settings.image_noise * torch.randn(levels.shape, generator=generator, dtype=torch.float32)
    return np.asarray(levels.round_().clamp_(0, 255).to(torch.uint8).numpy())


def vary_observation(
    observation: Observation,
    settings: ReconstructionSettings,  # as of `vary_image`; `touch_dropout`: probability to skip a touch
    generator: torch.Generator,
) -> Observation:
    """Vary the image of an observation, and skip some of its touch charts."""
    if observation.image is not None:
        observation = replace(observation, image=vary_image(observation.image, settings, generator))
    if settings.touch_dropout:
        kept = (torch.rand(len(observation.touched), generator=generator, dtype=torch.float32) >= settings.touch_dropout).numpy()
        observation = replace(observation, touch_vertices=observation.touch_vertices[kept], touched=observation.touched[kept])
    return observation


def draw_misplacement(
    deviation: float,  # of the shift along each axis, m, and of the logarithm of the scale in radii
    centre: Sequence[float],  # (3,) world, m, of the ball that objects lie in; they are scaled about it
    radius: float,  # of this ball, m
    generator: torch.Generator,
) -> NDArray[np.float64]:  # (4, 4) similarity, from where the object is to where it is taken to be
    """Draw the error of an object's estimated pose and size; a turn about +z is not among the errors."""
    *shift, scale = (deviation * torch.randn(4, generator=generator, dtype=torch.float64)).tolist()
    motion = scaling_about(centre, math.exp(scale / radius))
    motion[:3, 3] += shift
    return motion


def misplace(
    observation: Observation,  # with an image and its camera
    motion: NDArray[np.float64],  # (4, 4), from `draw_misplacement`
    centre: NDArray[np.float64],  # (3,) world, m, where the object is taken to be
) -> Observation:
    """Change an observation to what `predict` would make of it with a wrong estimate of the object's pose.

    The image shows `centre` where it showed the object's centre.
    """
    moved = observation.moved(motion)
    assert observation.image is not None
    assert observation.camera is not None
    assert moved.camera is not None
    turned = carried_camera(observation.camera, moved.camera, centre)
    rows, cols = observation.image.shape[:2]
    image, _ = transfer_view(observation.image, moved.camera, turned, (rows, cols), background_color(observation.image))
    return replace(moved, image=image, camera=turned)


def _within_one(count: int, generator: torch.Generator) -> Tensor:
    return 2 * torch.rand(count, generator=generator, dtype=torch.float32) - 1

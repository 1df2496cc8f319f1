"""Random variation of training items, against overfitting to the training set's colours and sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from pipeline.models.observation import Observation
from pipeline.training.settings import ReconstructionSettings, TrainingSettings


def vary_image(image: np.ndarray, settings: TrainingSettings, generator: torch.Generator) -> np.ndarray:
    """Scale and shift the colours of an image, and add noise to its pixels.

    Parameters
    ----------
    image
        (H, W, 3) uint8; the result has the same shape and type.
    settings
        Give `image_gain`, `image_shift` and `image_noise`; with all at 0 the image is returned unchanged.
    generator
        Draws the variation.
    """
    if not (settings.image_gain or settings.image_shift or settings.image_noise):
        return image
    scale = 1 + settings.image_gain * _within_one(3, generator)
    levels = torch.tensor(image, dtype=torch.float32) * scale + settings.image_shift * _within_one(3, generator)
    if settings.image_noise:
        levels += settings.image_noise * torch.randn(levels.shape, generator=generator, dtype=torch.float32)
    return np.asarray(levels.round_().clamp_(0, 255).to(torch.uint8).numpy())


def vary_observation(observation: Observation, settings: ReconstructionSettings, generator: torch.Generator) -> Observation:
    """Vary the image of an observation, and leave out some of its touch charts.

    Parameters
    ----------
    observation
        The observation.
    settings
        As `vary_image` takes them; and `touch_dropout`, the probability that a touch is left out.
    generator
        Draws the variation.
    """
    if observation.image is not None:
        observation = replace(observation, image=vary_image(observation.image, settings, generator))
    if settings.touch_dropout:
        kept = (torch.rand(len(observation.touched), generator=generator, dtype=torch.float32) >= settings.touch_dropout).numpy()
        observation = replace(observation, touch_vertices=observation.touch_vertices[kept], touched=observation.touched[kept])
    return observation


def _within_one(count: int, generator: torch.Generator) -> Tensor:
    return 2 * torch.rand(count, generator=generator, dtype=torch.float32) - 1

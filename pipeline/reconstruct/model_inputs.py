"""Describe the inputs that a trained network takes, and choose those that it gets from an observation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.networks.network_configurations import ImageKind, NetworkInputs
from pipeline.kernels.touch.sensor import Sensor
from pipeline.reconstruct.observation_file import RobotObservation


@dataclass(frozen=True)
class ModelInputs:
    """Describe the inputs that a model was trained with.

    Attributes
    ----------
    configuration, config
        Its name, and its inputs.
    camera, resolution, background
        (3, 4) projection matrix, of an object of the size that networks see, rows and columns, and background's sRGB of its images; None
        without images, or if not known.
    sensor
        Of its tactile images; None without touch.
    diagonals
        Of the smallest and the largest object that it learned from, m; None if not known.
    """

    configuration: str
    config: NetworkInputs
    camera: NDArray[np.float64] | None
    resolution: tuple[int, int] | None
    background: tuple[int, int, int] | None
    sensor: Sensor | None
    diagonals: tuple[float, float] | None = None


def used_inputs(config: NetworkInputs, observation: RobotObservation) -> NetworkInputs:
    """Choose the inputs that a network gets from an observation; a network that takes any inputs gets those that are present.

    An image in which a hand is marked is an occluded one: the hand is left in it.
    """
    if config.image != "any":
        return config
    camera = observation.camera
    image: ImageKind | None = None if camera is None else "unoccluded" if camera.hand_mask is None else "occluded"
    return config.restricted_to(NetworkInputs(image=image, touch=observation.is_felt))


def learned_size(model: ModelInputs) -> float:
    """Compute the middle, on a scale of ratios, of the sizes of the objects that a model learned from, m."""
    return 2 * model.config.radius if model.diagonals is None else float(np.sqrt(np.prod(model.diagonals)))

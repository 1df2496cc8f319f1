"""What is seen and felt of objects, as the deformation network's input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pipeline.dataset.touch_charts import is_surface
from pipeline.errors import InvalidInput
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.image_tensors import network_input


@dataclass(frozen=True)
class Observation:
    """What is seen and felt of one object.

    Attributes
    ----------
    image
        (rows, cols, 3) uint8, None for networks without image.
    touch_vertices
        (T, S, 3) float32 touch charts of all sensors of all grasps given, world, m; T may be 0.
    touched
        (T,) bool: whether the chart is that of a successful touch.
    """

    image: np.ndarray | None
    touch_vertices: np.ndarray
    touched: np.ndarray

    @staticmethod
    def without_touch(image: np.ndarray | None) -> Observation:
        """Make an observation without touch."""
        return Observation(image, np.zeros((0, 0, 3), np.float32), np.zeros(0, bool))

    @staticmethod
    def with_charts(image: np.ndarray | None, vertices: np.ndarray, stop_rule: np.ndarray) -> Observation:
        """Make an observation of the stored charts of some grasps: vertices (grasp, sensor, S, 3), m, and stop_rule (grasp, sensor)."""
        return Observation(image, vertices.reshape(-1, *vertices.shape[2:]), is_surface(stop_rule).reshape(-1))


@dataclass(frozen=True)
class NetworkBatch:
    """Observations as a network takes them, on its device.

    Attributes
    ----------
    images
        (B, 3, H, W) in [0, 1], None for networks without image.
    touch_vertices, touched
        (T, S, 3) charts of all items, world, m, and which of them are of a successful touch (T,); None for networks without touch.
    counts
        Touch charts of each item.
    """

    images: Tensor | None
    touch_vertices: Tensor | None
    touched: Tensor | None
    counts: list[int]


def stack_observations(observations: Sequence[Observation], network: DeformationNetwork) -> NetworkBatch:
    """Stack observations as tensors of the network's device and type.

    Raises
    ------
    InvalidInput
        An image that the network takes is missing, or the images differ in size.
    ValueError
        There is no observation, or charts have another number of vertices than the network's.
    """
    if not observations:
        raise ValueError("there is no observation to reconstruct from; one at least")
    config = network.config
    like = next(network.parameters())
    images = touch_vertices = touched = None
    if config.image is not None:
        pictures = [seen.image for seen in observations if seen.image is not None]
        if len(pictures) != len(observations) or len({picture.shape for picture in pictures}) != 1:
            raise InvalidInput("the network takes an image of each object, all of one size; some are missing or differ")
        images = network_input(torch.from_numpy(np.stack(pictures)).to(like.device), like.dtype)
    counts = [len(felt.touched) if config.touch else 0 for felt in observations]
    if config.touch:
        size = config.side**2
        for felt in observations:
            if felt.touch_vertices.shape != (len(felt.touched), size, 3):
                raise ValueError(
                    f"touch charts have shape {felt.touch_vertices.shape}; {len(felt.touched)} charts of {size} vertices are needed"
                )
        touch_vertices = torch.from_numpy(np.concatenate([felt.touch_vertices for felt in observations])).to(like)
        touched = torch.from_numpy(np.concatenate([felt.touched for felt in observations])).to(like.device)
    return NetworkBatch(images, touch_vertices, touched, counts)

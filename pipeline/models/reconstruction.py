"""Trained deformation networks: from what is seen and felt of an object to its surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipeline.errors import InvalidInput
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.network_configurations import NetworkConfig
from pipeline.models.model_files import load_model
from pipeline.models.observation import NetworkBatch, Observation, stack_observations


@dataclass(frozen=True)
class Reconstruction:
    """A predicted surface.

    Attributes
    ----------
    vertices
        (V, 3) float64 in the world, m: vision charts first, then the charts of successful touches; charts of touches that
        failed are no part of the surface.
    faces
        (F, 3) int64.
    vision
        How many of the vertices belong to vision charts.
    position
        (vision,) int64: which of the sphere's distinct positions each of these has; equal ones coincided before deformation.
    side
        Vertices along a side of a touch chart.
    """

    vertices: np.ndarray
    faces: np.ndarray
    vision: int
    position: np.ndarray
    side: int


def assemble_surfaces(network: DeformationNetwork, deformed: Tensor, batch: NetworkBatch) -> Iterator[tuple[Tensor, Tensor]]:
    """Join each item's vision charts, `deformed` (B, V, 3), and the charts of its successful touches.

    Yields
    ------
    Each item's vertices (V, 3), world, m, and faces (F, 3).
    """
    vision_faces = torch.tensor(network.charts.faces, device=deformed.device)
    touch_faces = chart_square(network.config.side)[1].to(deformed.device)
    charts_of, touched_of = torch.split(batch.touch_vertices, batch.counts), torch.split(batch.touched, batch.counts)
    for vision, charts, touched in zip(deformed, charts_of, touched_of, strict=True):
        surface = charts[touched]  # (K, S, 3)
        first = len(vision) + torch.arange(len(surface), device=vision.device) * surface.shape[1]
        faces = (touch_faces + first[:, None, None]).reshape(-1, 3)
        yield torch.cat([vision, surface.reshape(-1, 3)]), torch.cat([vision_faces, faces])


class Reconstructor:
    """A trained deformation network, from its folder.

    Attributes
    ----------
    configuration
        Its name.
    config
        Its inputs and sizes.
    image
        Which image it is given: None, "occluded" or "unoccluded".
    touch
        Whether it is given touch charts.
    chart_settings
        The settings of `fit-charts` that its touch charts were fitted with; None without touch.
    """

    def __init__(self, folder: Path, device: torch.device | str = "cpu") -> None:
        weights, description = load_model(folder)
        self.configuration: str = description["configuration"]
        self.config = NetworkConfig.model_validate(description["network"])
        self.image, self.touch = self.config.image, self.config.touch
        self.chart_settings: dict[str, Any] | None = description["charts"]
        self.network = DeformationNetwork(self.config).to(device).eval()
        self.network.load_state_dict(weights)
        self._camera = None if description["camera"] is None else torch.tensor(description["camera"], dtype=torch.float64, device=device)
        self._resolution = description["resolution"]

    @torch.no_grad()
    def reconstruct(self, observations: Sequence[Observation]) -> list[Reconstruction]:
        """Reconstruct the surfaces of a batch of objects.

        Raises
        ------
        InvalidInput
            An image is missing or has another size than the network was trained on, or an observation holds NaN.
        ValueError
            There is no observation, or its arrays have other shapes or types than the network takes.
        """
        batch = stack_observations(observations, self.config, self._camera, like=next(self.network.parameters()))
        if batch.images is not None and list(batch.images.shape[2:]) != self._resolution:
            raise InvalidInput(
                f"{self.configuration} was trained on images of {self._resolution} pixels, these have {list(batch.images.shape[2:])}"
            )
        charts, deformed = self.network.charts, self.network(**vars(batch))
        return [
            Reconstruction(
                vertices=vertices.double().cpu().numpy(),
                faces=faces.cpu().numpy(),
                vision=len(charts.vertices),
                position=charts.position,
                side=self.config.side,
            )
            for vertices, faces in assemble_surfaces(self.network, deformed, batch)
        ]

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


def deform(network: torch.nn.Module, batch: NetworkBatch, camera: Tensor | None) -> Tensor:
    """Deform the vision charts of a batch: (B, V, 3), world, m. `camera` is the projection matrix (3, 4) of its images."""
    deformed: Tensor = network(
        images=batch.images, camera=camera, touch_vertices=batch.touch_vertices, touched=batch.touched, counts=batch.counts
    )
    return deformed


class SurfaceAssembler:
    """Joins deformed vision charts and the charts of successful touches as meshes."""

    def __init__(self, network: DeformationNetwork) -> None:
        self._side = network.config.side
        device = next(network.parameters()).device
        self._vision_faces = torch.tensor(network.charts.faces, device=device)
        self._touch_faces = chart_square(self._side)[1].to(device)

    def surfaces(self, deformed: Tensor, batch: NetworkBatch) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield each item's vertices (V, 3), world, m, and faces (F, 3); `deformed` is (B, V, 3) from `deform`."""
        begin = 0
        for vision, count in zip(deformed, batch.counts, strict=True):
            if batch.touch_vertices is None or batch.touched is None:
                yield vision, self._vision_faces
                continue
            charts = batch.touch_vertices[begin : begin + count][batch.touched[begin : begin + count]]  # (K, S, 3)
            begin += count
            first = len(vision) + torch.arange(len(charts), device=vision.device) * self._side**2
            faces = (self._touch_faces[None] + first[:, None, None]).reshape(-1, 3)
            yield torch.cat([vision, charts.reshape(-1, 3)]), torch.cat([self._vision_faces, faces])


class Reconstructor:
    """A trained deformation network, from its folder.

    Attributes
    ----------
    configuration
        Its name.
    image
        Which image it is given: None, "occluded" or "unoccluded".
    touch
        Whether it is given touch charts.
    side
        Vertices along a side of a touch chart.
    chart_settings
        The settings of `fit-charts` that its touch charts were fitted with; None without touch.
    """

    def __init__(self, folder: Path, device: torch.device | str = "cpu") -> None:
        weights, description = load_model(folder)
        config = NetworkConfig.model_validate(description["network"])
        self.configuration: str = description["configuration"]
        self.image, self.touch, self.side = config.image, config.touch, config.side
        self.chart_settings: dict[str, Any] | None = description["charts"]
        self.network = DeformationNetwork(config).to(device)
        self.network.load_state_dict(weights)
        self.network.eval()
        self._camera = None if description["camera"] is None else torch.tensor(description["camera"], dtype=torch.float64, device=device)
        self._resolution = description["resolution"]
        self._assembler = SurfaceAssembler(self.network)

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
        batch = stack_observations(observations, self.network)
        if batch.images is not None and list(batch.images.shape[2:]) != self._resolution:
            raise InvalidInput(
                f"{self.configuration} was trained on images of {self._resolution} pixels, these have {list(batch.images.shape[2:])}"
            )
        deformed = deform(self.network, batch, self._camera)
        charts, found = self.network.charts, []
        for vertices, faces in self._assembler.surfaces(deformed, batch):
            arrays = vertices.double().cpu().numpy(), faces.cpu().numpy()
            found.append(Reconstruction(*arrays, vision=len(charts.vertices), position=charts.position, side=self.side))
        return found

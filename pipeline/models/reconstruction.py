"""Trained deformation networks: from what is seen and felt of an object to its surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, model_validator
from torch import Tensor

from pipeline.errors import InvalidInput
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.implicit_configurations import ImplicitConfig
from pipeline.kernels.networks.network_configurations import NetworkConfig, NetworkInputs
from pipeline.models.model_files import load_network, read_description
from pipeline.models.observation import NetworkBatch, Observation, stack_observations

ImageRow = tuple[float, float, float, float]
C = TypeVar("C", NetworkConfig, ImplicitConfig)


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

    @property
    def is_whole(self) -> bool:
        """Whether it is one mesh, as implicit networks make it, in place of charts: none of its vertices coincided with another one."""
        return len(self.position) == len(np.unique(self.position))


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


class Description(BaseModel, Generic[C]):
    """What a trained network's folder says of it."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    configuration: str
    network: C
    camera: tuple[ImageRow, ImageRow, ImageRow] | None
    resolution: tuple[int, int] | None
    charts: dict[str, Any] | None

    @model_validator(mode="after")
    def _of_its_inputs(self) -> Description[C]:
        image, touch = self.network.image is not None, self.network.touch
        camera = image and self.network.image != "rendering"  # each rendering has its own
        if (self.camera is not None, self.resolution is not None, self.charts is not None) != (camera, image, touch):
            raise ValueError("a network with an image has camera and resolution, one with touch has charts; the others have none")
        return self


class Reconstructor:
    """A trained deformation network, from its folder.

    Attributes
    ----------
    configuration
        Its name.
    config
        Its inputs and sizes.
    image
        Which image it is given: None, "occluded", "unoccluded" or "rendering".
    touch
        Whether it is given touch charts.
    camera
        (3, 4) float64, the projection matrix of its images; None without an image.
    chart_settings
        The settings of `fit-charts` that its touch charts were fitted with; None without touch.
    """

    config: NetworkInputs
    has_charts = True
    """Whether it deforms vision charts; else it makes meshes of its own."""

    def __init__(self, folder: Path, device: torch.device | str = "cpu") -> None:
        said = read_description(folder, Description[NetworkConfig])
        self._take(said, device)
        self.network = load_network(folder, lambda: DeformationNetwork(said.network), device)

    def _take(self, said: Description[Any], device: torch.device | str) -> None:
        self.configuration, self.config, self.chart_settings = said.configuration, said.network, said.charts
        self.image, self.touch = self.config.image, self.config.touch
        self.camera = None if said.camera is None else np.array(said.camera)
        self._camera = None if said.camera is None else torch.tensor(said.camera, dtype=torch.float64, device=device)
        self._resolution = said.resolution and list(said.resolution)

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
        batch = self._batch(observations, like=next(self.network.parameters()))
        charts, deformed = self.network.charts, self.network(**vars(batch))
        return [
            Reconstruction(
                vertices=vertices.double().cpu().numpy(),
                faces=faces.cpu().numpy(),
                vision=len(charts.vertices),
                position=charts.position,
                side=self.network.config.side,
            )
            for vertices, faces in assemble_surfaces(self.network, deformed, batch)
        ]

    def _batch(self, observations: Sequence[Observation], like: Tensor) -> NetworkBatch:
        """Stack observations, whose images must be as large as those of the training."""
        batch = stack_observations(observations, self.config, self._camera, like=like)
        if batch.images is not None and list(batch.images.shape[2:]) != self._resolution:
            raise InvalidInput(
                f"{self.configuration} was trained on images of {self._resolution} pixels, these have {list(batch.images.shape[2:])}"
            )
        return batch

"""From what is seen and felt of an object to its surface: the graph network's inputs put together, and its output as a mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipeline.dataset.touch_charts import is_surface
from pipeline.errors import StageError
from pipeline.kernels.charts.chart_square import chart_square
from pipeline.kernels.networks.configurations import NetworkConfig
from pipeline.kernels.networks.deformation import DeformationNetwork
from pipeline.kernels.networks.images import network_input
from pipeline.models.model_files import load_model


@dataclass(frozen=True)
class View:
    """What is known of one object.

    Attributes
    ----------
    image
        (rows, cols, 3) uint8, None for networks without vision.
    touch_vertices
        (T, S, 3) float32 touch charts in the world, m, of all sensors of all grasps given; T may be 0.
    touched
        (T,) bool: whether the chart is that of a successful touch.
    """

    image: np.ndarray | None
    touch_vertices: np.ndarray
    touched: np.ndarray

    @staticmethod
    def unfelt(image: np.ndarray | None) -> View:
        """A view without touch."""
        return View(image, np.zeros((0, 0, 3), np.float32), np.zeros(0, bool))

    @staticmethod
    def felt(image: np.ndarray | None, vertices: np.ndarray, stop_rule: np.ndarray) -> View:
        """A view with the stored charts of some grasps: vertices (grasp, sensor, S, 3), m, and stop_rule (grasp, sensor)."""
        return View(image, vertices.reshape(-1, *vertices.shape[2:]), is_surface(stop_rule).reshape(-1))


@dataclass(frozen=True)
class Batch:
    """Views as a network takes them, on its device: images (B, 3, H, W), charts (T, S, 3) and touched (T,) of all items, counts of each."""

    images: Tensor | None
    touch_vertices: Tensor | None
    touched: Tensor | None
    counts: list[int]


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


def assemble(views: Sequence[View], network: DeformationNetwork) -> Batch:
    """Views as tensors of the network's device and type.

    Raises
    ------
    ValueError
        There is no view; one lacks what the network looks at, or its charts have another number of vertices.
    """
    if not views:
        raise ValueError("there is no view to reconstruct from; one at least")
    config = network.config
    like = next(network.parameters())
    images = touch_vertices = touched = None
    if config.image is not None:
        pictures = [view.image for view in views if view.image is not None]
        if len(pictures) != len(views) or len({picture.shape for picture in pictures}) != 1:
            raise ValueError("the network looks at an image of every object, all of one size; some are missing or differ")
        stacked = torch.from_numpy(np.stack(pictures)).to(like.device)
        images = network_input(stacked, like.dtype)
    counts = [len(view.touched) if config.touch else 0 for view in views]
    if config.touch:
        size = config.side**2
        for view in views:
            if view.touch_vertices.shape != (len(view.touched), size, 3):
                raise ValueError(
                    f"touch charts have shape {view.touch_vertices.shape}; {len(view.touched)} charts of {size} vertices are needed"
                )
        touch_vertices = torch.from_numpy(np.concatenate([view.touch_vertices for view in views])).to(like)
        touched = torch.from_numpy(np.concatenate([view.touched for view in views])).to(like.device)
    return Batch(images, touch_vertices, touched, counts)


def deform(network: torch.nn.Module, batch: Batch, camera: Tensor | None) -> Tensor:
    """(B, V, 3) deformed vertices of the vision charts in the world, m."""
    deformed: Tensor = network(batch.images, camera, batch.touch_vertices, batch.touched, batch.counts)
    return deformed


class SurfaceTopology:
    """Puts deformed vision charts and successful touch charts together as meshes."""

    def __init__(self, network: DeformationNetwork) -> None:
        self.sphere = network.sphere
        self.side = network.config.side
        device = next(network.parameters()).device
        self._vision = torch.tensor(self.sphere.faces, device=device)
        self._touch = chart_square(self.side)[1].to(device)

    def surfaces(self, deformed: Tensor, batch: Batch) -> Iterator[tuple[Tensor, Tensor]]:
        """Vertices (V, 3), m, and faces (F, 3) of every item."""
        begin = 0
        for vision, count in zip(deformed, batch.counts, strict=True):
            if batch.touch_vertices is None or batch.touched is None:
                yield vision, self._vision
                continue
            charts = batch.touch_vertices[begin : begin + count][batch.touched[begin : begin + count]]  # (K, S, 3)
            begin += count
            first = len(vision) + torch.arange(len(charts), device=vision.device) * self.side**2
            faces = (self._touch[None] + first[:, None, None]).reshape(-1, 3)
            yield torch.cat([vision, charts.reshape(-1, 3)]), torch.cat([self._vision, faces])


class Reconstructor:
    """A trained graph network, from its folder.

    Attributes
    ----------
    configuration
        Its name.
    image
        Which image it looks at: None, "occluded" or "unoccluded".
    touch
        Whether it feels.
    charts
        The settings of `fit-charts` that its touch charts were fitted with; None for one that does not feel.
    """

    def __init__(self, folder: Path, device: torch.device | str = "cpu") -> None:
        weights, description = load_model(folder)
        config = NetworkConfig.model_validate(description["network"])
        self.configuration: str = description["configuration"]
        self.image, self.touch, self.side = config.image, config.touch, config.side
        self.charts: dict[str, Any] | None = description["charts"]
        self.network = DeformationNetwork(config).to(device)
        self.network.load_state_dict(weights)
        self.network.eval()
        self._camera = None if description["camera"] is None else torch.tensor(description["camera"], dtype=torch.float64, device=device)
        self._resolution = description["resolution"]
        self._topology = SurfaceTopology(self.network)

    @torch.no_grad()
    def reconstruct(self, views: Sequence[View]) -> list[Reconstruction]:
        """The surfaces of a batch of objects.

        Raises
        ------
        StageError
            There is no view; or one lacks what the network looks at, holds NaN, or has an image of another size than it was
            trained on.
        """
        try:
            batch = assemble(views, self.network)
            if batch.images is not None and list(batch.images.shape[2:]) != self._resolution:
                raise ValueError(f"it was trained on images of {self._resolution} pixels, these have {list(batch.images.shape[2:])}")
            deformed = deform(self.network, batch, self._camera)
        except ValueError as error:
            raise StageError(f"{self.configuration}: {error}") from error
        found = []
        for vertices, faces in self._topology.surfaces(deformed, batch):
            sphere = self._topology.sphere
            arrays = vertices.double().cpu().numpy(), faces.cpu().numpy()
            found.append(Reconstruction(*arrays, vision=len(sphere.vertices), position=sphere.position, side=self.side))
        return found

"""Trained networks, from images and touches to a surface: vision charts deformed around touch charts, or signed distances meshed."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, SerializeAsAny, create_model, model_validator
from torch import Tensor, nn

from pipeline.entries import Entries
from pipeline.errors import InvalidInput
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.geometry.closed_surface import RESOLUTION, closed_surface, vertex_normals
from pipeline.kernels.geometry.level_set import level_set_mesh
from pipeline.kernels.geometry.transforms import invert_similarity, transform_points
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.implicit_network import Encoding, ImplicitNetwork
from pipeline.kernels.networks.network_configurations import ImplicitConfig, NetworkConfig, NetworkInputs
from pipeline.kernels.vision.camera import DrawnViews, project_points
from pipeline.kernels.vision.view_transfer import camera_direction, carried_camera
from pipeline.models.model_files import load_network, read_description
from pipeline.models.observation import ChartBatch, Observation, stack_observations

ImageRow = tuple[float, float, float, float]
Level = Annotated[int, Field(ge=0, le=255)]
VIEW_DEGREES, VIEW_SHARE = 1.0, 0.01
"""Largest differences of a view from the training's: of its direction, and of pixels as a share of the image."""
QUERIES = 2**12
"""Points whose distances are predicted at a time: their features stay in a processor's cache, a fifth faster than eight times as many."""
MARGIN = 1.04  # half the side of the meshed cube, in radii: beyond any object that was scaled to 0.5 m
HALVINGS = 3  # times that the spacing of the first predictions is halved, where the surface may be


@dataclass(frozen=True)
class Reconstruction:
    """A predicted surface."""

    # (V, 3) float64 world, m: of vision charts, then of the charts of successful touches, none of others
    vertices: np.ndarray
    faces: np.ndarray  # (F, 3) int64
    vision: int  # how many of the vertices belong to vision charts
    # (vision,) int64: which of the sphere's distinct positions each has; equal ones coincided before deformation
    position: np.ndarray
    side: int  # vertices along a side of a touch chart
    is_guess: bool = False  # no point is inside the object for the network: the surface is around the likeliest one

    @property
    def is_whole(self) -> bool:
        """Whether it is one mesh, as of implicit networks, instead of charts: no two of its vertices have one position."""
        return len(self.position) == len(np.unique(self.position))


class Trained(Entries):
    """Describe a trained network: written by its training as `model.json`, read by everything that applies it."""

    configuration: str  # the network's name
    network: SerializeAsAny[NetworkInputs]  # inputs and sizes, of the family's type
    camera: tuple[ImageRow, ImageRow, ImageRow] | None  # projection matrix of the first training object's image, scaled with it
    drawn: DrawnViews | None = None  # where its camera was in each image; None: always at the place of `camera`
    resolution: tuple[int, int] | None  # rows and columns of its images
    background: tuple[Level, Level, Level] | None = None  # sRGB behind them; None without images, or if not known
    charts: dict[str, Any] | None  # settings of `fit-charts`; None without touch charts
    diagonals: tuple[float, float] | None = None  # of the smallest and largest object that it learned from, m; None if not known
    gels: tuple[float, float] | None = None  # least and greatest width of a gel over its object's diagonal; None for touch charts

    @model_validator(mode="after")
    def _of_its_inputs(self) -> Self:
        image, charts = self.network.image is not None, self.network.takes_charts
        camera = image and self.network.image != "rendering"  # each rendering has its own
        if (self.camera is not None, self.resolution is not None, self.charts is not None) != (camera, image, charts):
            raise ValueError("a network with an image has camera and resolution, one with touch charts has charts; others have none")
        return self

    @cached_property
    def projection(self) -> NDArray[np.float64] | None:
        """`camera` as an array (3, 4)."""
        return None if self.camera is None else np.array(self.camera)

    @property
    def sizes(self) -> tuple[float, float]:
        """Diagonals of the smallest and largest object that it learned from, m."""
        return self.diagonals or (2 * self.network.radius, 2 * self.network.radius)

    def restricted_to(self, inputs: NetworkInputs) -> Self:
        """Describe a network that takes any inputs as one that takes these."""
        return self.model_copy(update={"network": self.network.restricted_to(inputs)})

    def learned_direction(self, camera: NDArray[np.float64]) -> tuple[float, float]:
        """Find the training's azimuth and elevation, degrees, that are nearest to those of a camera (3, 4) of a network with images."""
        assert self.projection is not None
        directions = (camera_direction(matrix, np.array(self.network.centre)) for matrix in (camera, self.projection))
        own, trained = (np.degrees(direction[:2]).tolist() for direction in directions)
        return tuple(trained) if self.drawn is None else self.drawn.nearest(*own)

    def has_view(
        self,
        camera: NDArray[np.float64],  # (3, 4) projection matrix, of an object of the size that networks see
    ) -> bool:
        """Check whether a camera sees an object from a side that the training's camera did, and as large."""
        if self.projection is None or self.resolution is None:
            return False
        centre = np.array(self.network.centre)
        corners = centre + self.network.radius * (np.indices((2, 2, 2)).reshape(3, -1).T * 2.0 - 1) / np.sqrt(3)
        own, (azimuth, elevation) = camera_direction(camera, centre), self.learned_direction(camera)
        turns = np.degrees([own.azimuth, own.elevation]) - [azimuth, elevation]
        seen, expected = (project_points(matrix, corners) for matrix in (camera, carried_camera(self.projection, camera, centre)))
        is_same_side = np.abs((turns + 180) % 360 - 180).max() <= VIEW_DEGREES
        return bool(is_same_side and np.abs(seen - expected).max() <= VIEW_SHARE * max(self.resolution))


class Reconstructor(ABC):
    """A trained network, from its folder; each subclass makes surfaces in its way, for families of `pipeline/models/families.py`."""

    config_type: ClassVar[type[NetworkInputs]]  # describes its networks
    network_type: ClassVar[type[nn.Module]]  # called as `network_type(config, generator)`
    has_charts: ClassVar[bool] = False  # deforms vision charts; else it makes meshes of its own

    def __init__(self, folder: Path, device: torch.device | str = "cpu") -> None:
        self.trained = self.described(folder)
        self.network = load_network(folder, lambda: self.network_type(self.trained.network), device)

    @classmethod
    def described(cls, folder: Path) -> Trained:
        """Read the description of a trained network, without its weights."""
        return read_description(folder, create_model("Trained", __base__=Trained, network=cls.config_type))

    @property
    def config(self) -> NetworkInputs:
        """Inputs and sizes."""
        return self.trained.network

    def restricted_to(self, inputs: NetworkInputs) -> Self:
        """Make a reconstructor with the same network, which takes any inputs, and these inputs."""
        restricted = copy.copy(self)
        restricted.trained = self.trained.restricted_to(inputs)
        return restricted

    @torch.no_grad()
    def reconstruct(self, observations: Sequence[Observation]) -> list[Reconstruction]:
        """Reconstruct the surfaces of a batch of objects."""
        surfaces = self._surfaces(observations)
        for number, observation in enumerate(observations):
            if observation.scale != 1 or observation.turn:  # back to where the object is, in its size
                motion = invert_similarity(observation.placement(self.config.centre))
                surfaces[number] = replace(surfaces[number], vertices=transform_points(motion, surfaces[number].vertices))
        return surfaces

    @abstractmethod
    def _surfaces(self, observations: Sequence[Observation]) -> list[Reconstruction]:
        """Compute the reconstructions of a batch, of objects as large as those that the network learned from."""

    def _batch(self, observations: Sequence[Observation]) -> Any:  # `ChartBatch` or `PointBatch`
        """Stack observations, whose images must be as large as those of the training."""
        like = next(self.network.parameters())
        camera = None if self.trained.camera is None else torch.tensor(self.trained.camera, dtype=torch.float64, device=like.device)
        batch = stack_observations(observations, self.config, camera, like)
        trained = list(self.trained.resolution or ())
        if batch.images is not None and list(batch.images.shape[2:]) != trained:
            raise InvalidInput(
                f"{self.trained.configuration} was trained on images of {trained} pixels, these have {list(batch.images.shape[2:])}: "
                "train on these"
            )
        return batch


class DeformationReconstructor(Reconstructor):
    """A trained deformation network, from its folder."""

    config_type = NetworkConfig
    network_type = DeformationNetwork
    has_charts = True
    network: DeformationNetwork

    def _surfaces(self, observations: Sequence[Observation]) -> list[Reconstruction]:
        batch = self._batch(observations)
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


def assemble_surfaces(
    network: DeformationNetwork,
    deformed: Tensor,  # (B, V, 3) vertices of the vision charts, world, m
    batch: ChartBatch,  # gives the touch charts
) -> Iterator[tuple[Tensor, Tensor]]:  # (V, 3) vertices, world, m, and (F, 3) faces, of each item
    """Join the vision charts of each item and the charts of its successful touches."""
    vision_faces = torch.tensor(network.charts.faces, device=deformed.device)
    touch_faces = chart_square(network.config.side)[1].to(deformed.device)
    charts_of, touched_of = torch.split(batch.touch_vertices, batch.counts), torch.split(batch.touched, batch.counts)
    for vision, charts, touched in zip(deformed, charts_of, touched_of, strict=True):
        surface = charts[touched]  # (K, S, 3)
        first = len(vision) + torch.arange(len(surface), device=vision.device) * surface.shape[1]
        faces = (touch_faces + first[:, None, None]).reshape(-1, 3)
        yield torch.cat([vision, surface.reshape(-1, 3)]), torch.cat([vision_faces, faces])


class ImplicitReconstructor(Reconstructor):
    """A trained implicit network, from its folder."""

    config_type = ImplicitConfig
    network_type = ImplicitNetwork
    network: ImplicitNetwork

    def _surfaces(self, observations: Sequence[Observation]) -> list[Reconstruction]:
        reconstructions = []
        for observation in observations:
            code = self.network.encode(**vars(self._batch([observation])))
            vertices, faces, is_guess = self._mesh(code)
            position = np.arange(len(vertices))
            reconstructions.append(Reconstruction(vertices, faces, len(vertices), position, self.config.side, is_guess))
        return reconstructions

    def _mesh(self, code: Encoding) -> tuple[NDArray[np.float64], NDArray[np.int64], bool]:
        """Mesh the zeros of one item's distances: vertices (V, 3), m, faces (F, 3), and whether they are a guess.

        They are if no point is inside: then this is a level set around the smallest distance. Without an image, only
        the largest piece and touched ones are kept: the others are guesses that exclude each other.
        """
        errors = self.network.errors_at_touches(code)

        def distances(points: NDArray[np.float64]) -> NDArray[np.float64]:
            queries = torch.from_numpy(points).to(code.overall)
            blocks = [self.network.decode_with_touches(code, block[None], errors)[0] for block in torch.split(queries, QUERIES)]
            return np.asarray(torch.cat(blocks).double().cpu().numpy())

        config = self.network.config
        centre, reach, spacing = np.array(config.centre), MARGIN * config.radius, config.spacing
        box = centre - reach, centre + reach
        vertices, faces = level_set_mesh(
            distances,
            *box,
            spacing,
            halvings=HALVINGS,
            dense_points=self.network.touched_points(code),
            dense_radius=config.touch_reach,
            loose_pieces=len(code.with_image) > 0,
        )
        if len(faces):
            return vertices, faces, False
        coarse = 4 * spacing  # this surface is a guess, and needs no detail
        grid = np.stack(np.meshgrid(*(np.arange(low, high, coarse) for low, high in zip(*box, strict=True)), indexing="ij"), axis=-1)
        lowest = distances(grid.reshape(-1, 3)).min() + 1e-6  # a micrometre: the same points may be rounded differently in other batches
        return *level_set_mesh(lambda points: distances(points) - lowest, *box, coarse, halvings=0), True


def join_vision_charts(
    reconstruction: Reconstruction,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:  # vertices (P, 3) m, faces (F, 3)
    """Join the vision charts to one closed surface, with one vertex per distinct position."""
    position = reconstruction.position
    count = np.bincount(position)
    vertices = (
        np.stack([np.bincount(position, weights=axis) for axis in reconstruction.vertices[: reconstruction.vision].T], axis=1)
        / count[:, None]
    )
    return vertices, position[reconstruction.faces[(reconstruction.faces < reconstruction.vision).all(axis=1)]]


def close_reconstruction(
    reconstruction: Reconstruction,
    resolution: int = RESOLUTION,  # edges along the longest side of the surface's box, 64 or more
    observation: Observation | None = None,  # gives the touches of an implicit network
) -> tuple[NDArray[np.float64], NDArray[np.integer]]:  # vertices (V, 3) m, faces (F, 3)
    """Make one closed, smooth mesh of a reconstruction, through touched points; see `closed_surface`."""
    charts: Sequence[NDArray[Any]] = [*reconstruction.vertices[reconstruction.vision :].reshape(-1, reconstruction.side**2, 3)]
    felt: list[tuple[NDArray[Any], NDArray[Any]]] = []
    if observation is not None:
        touches = [touch for touch in observation.touches if touch.touched]
        charts = [touch.chart.astype(np.float64) for touch in touches if touch.chart is not None]
        felt = [(touch.points, touch.normals) for touch in touches if touch.chart is None]
    faces = chart_square(reconstruction.side)[1].numpy()
    felt += [(chart, -vertex_normals(chart, faces)) for chart in charts]
    points, normals = (np.concatenate([np.zeros((0, 3)), *values]) for values in (zip(*felt, strict=True) if felt else ((), ())))
    vertices, closed_faces = closed_surface(*join_vision_charts(reconstruction), points, normals, resolution=resolution)
    return vertices, np.asarray(closed_faces, np.int64)

"""Observations of objects: the images and touch charts that networks are given."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from pipeline.dataset.object_rows import ObjectRows, is_surface
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.transforms import scaling_about, transform_points
from pipeline.kernels.networks.network_configurations import NetworkInputs
from pipeline.kernels.tensors import network_input
from pipeline.kernels.vision.view_transfer import moved_projection


@dataclass(frozen=True)
class Observation:
    """Hold the image and touches of one object."""

    image: np.ndarray | None  # (rows, cols, 3) uint8; None for networks without image
    # (T, S, 3) float32 world, m: touch charts of all sensors of all given grasps; by default none
    touch_vertices: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3), np.float32))
    touched: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))  # (T,) bool: of successful touches
    camera: np.ndarray | None = None  # (3, 4) world, m, to image pixels; None without one, or if it is the training's
    scale: float = 1.0  # about the centre of the network's ball; makes the object as large as those learned from

    def scaled(self, centre: Sequence[float]) -> "Observation":
        """Scale the object with its touches and its camera about a point (3,), world, m, so that the image stays the same."""
        return self if self.scale == 1 else replace(self.moved(scaling_about(centre, self.scale)), scale=1.0)

    def moved(self, motion: np.ndarray) -> "Observation":
        """Move the object with its touches and its camera by a similarity (4, 4), m, so that the image stays the same."""
        camera = None if self.camera is None else moved_projection(self.camera, motion)
        vertices = transform_points(motion, self.touch_vertices.astype(np.float64)).astype(np.float32)
        return replace(self, touch_vertices=vertices, camera=camera)


def observed_arrays(config: NetworkInputs) -> tuple[str, ...]:
    """Name the arrays of a dataset that a network is given."""
    camera = [] if config.image is None else ["rendering_camera" if config.image == "rendering" else "projection"]
    return (*stored_images(config), *camera, *(("vertices", "stop_rule") if config.touch else ()))


def stored_images(config: NetworkInputs) -> tuple[str, ...]:
    """Name the arrays of the images that a network may be given."""
    if config.image == "any":
        return ("occluded", "unoccluded")
    return () if config.image is None else (config.image,)


def stored_observation(
    rows: ObjectRows,  # hold the arrays that `observed_arrays` names
    object_id: str,
    grasps: Sequence[int],  # whose charts are given; the image is the first camera's of the first; or a viewpoint
    config: NetworkInputs,  # of a network that takes any inputs, those of this observation
) -> Observation:
    """Read the observation of a stored object that a network is given."""
    image, camera, scale = None, None, scale_of(rows, object_id, config)
    if config.image is not None:
        image = rows.read(config.image, object_id, grasps[0], camera=0)
        if config.image == "rendering":
            camera = rows.read("rendering_camera", object_id, grasps[0])
        else:
            view = 0 if config.image == "unoccluded" else 1 + grasps[0]
            camera = rows.read("projection", object_id, camera=0)[view]
    if not config.touch:
        return Observation(image, camera=camera, scale=scale)
    vertices, stop_rule = (rows.read(name, object_id)[list(grasps)] for name in ("vertices", "stop_rule"))  # (grasp, sensor, …)
    return Observation(image, vertices.reshape(-1, *vertices.shape[2:]), is_surface(stop_rule).reshape(-1), camera, scale)


def stored_cameras(rows: ObjectRows, object_id: str, config: NetworkInputs) -> np.ndarray:
    """Read the projection matrices (view, 3, 4) of an object's images, scaled with the object to the size that networks learn."""
    scale, matrices = scale_of(rows, object_id, config), rows.read("projection", object_id, camera=0)
    return np.array([Observation(None, camera=matrix, scale=scale).scaled(config.centre).camera for matrix in matrices])


def scale_of(rows: ObjectRows, object_id: str, config: NetworkInputs) -> float:
    """Compute the factor that makes an object as large as those that networks learn, 1 for objects that were scaled to 0.5 m."""
    return 2 * config.radius / rows.diagonal(object_id)


@dataclass(frozen=True)
class NetworkBatch:
    """Observations as the arguments of a network, on its device."""

    images: Tensor | None
    camera: Tensor | None
    touch_vertices: Tensor
    touched: Tensor
    counts: list[int]


def stack_observations(
    observations: Sequence[Observation],  # one per item; they are scaled to the size that the network learned
    config: NetworkInputs,  # if it takes any image, items without one get black ones, and zeros for a camera
    camera: Tensor | None,  # (3, 4) projection matrix of images without their own; None if each has its own
    like: Tensor,
) -> NetworkBatch:
    """Stack observations as tensors of the device and type of `like`."""
    if not observations:
        raise ValueError("observations is empty; give at least one")
    observations, images, cameras = [observation.scaled(config.centre) for observation in observations], None, camera
    pictures = [observation.image for observation in observations if observation.image is not None]
    if config.image == "any" and 0 < len(pictures) < len(observations):
        blank, nowhere = np.zeros_like(pictures[0]), np.zeros((3, 4))
        observations = [replace(seen, image=blank, camera=nowhere) if seen.image is None else seen for seen in observations]
        pictures = [np.asarray(observation.image) for observation in observations]
    if config.image is not None and (pictures or config.image != "any"):
        if len(pictures) != len(observations) or len({picture.shape for picture in pictures}) != 1:
            raise InvalidInput(
                "the network takes an image of each object, all of one size (render-vision.resolution); some are missing or differ"
            )
        if any(observation.camera is not None for observation in observations):
            own = [camera if seen.camera is None else torch.tensor(seen.camera, device=like.device) for seen in observations]
            cameras = torch.stack([matrix for matrix in own if matrix is not None])
        images = network_input(torch.from_numpy(np.stack(pictures)).to(like.device), like.dtype)
    if not config.touch or not any(len(observation.touched) for observation in observations):
        no_charts = like.new_zeros(0, config.side**2, 3)
        return NetworkBatch(images, cameras, no_charts, no_charts.new_zeros(0, dtype=torch.bool), [0] * len(observations))
    charts = np.concatenate([observation.touch_vertices for observation in observations if len(observation.touched)])
    touched = torch.from_numpy(np.concatenate([observation.touched for observation in observations])).to(like.device)
    return NetworkBatch(images, cameras, torch.from_numpy(charts).to(like), touched, [len(seen.touched) for seen in observations])

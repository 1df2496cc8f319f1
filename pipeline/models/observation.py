"""Observations of objects: the images and touches that networks are given."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from pipeline.dataset.object_rows import ObjectRows, is_surface
from pipeline.errors import InvalidInput
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.geometry.transforms import rotation_from_euler, scaling_about
from pipeline.kernels.networks.network_configurations import NetworkInputs
from pipeline.kernels.networks.touch_points import TouchPoints, pad_touches
from pipeline.kernels.tensors import network_input
from pipeline.kernels.touch.depth_maps import gel_surface, pressed_pixels
from pipeline.kernels.touch.sensor import Sensor, check_pose, sensor_to_world
from pipeline.kernels.touch.touched_points import Touch, chart_touches, gel_touch, touched_flags
from pipeline.kernels.vision.view_transfer import moved_projection

CHART_ARRAYS, GEL_ARRAYS = ("vertices", "stop_rule"), ("depth", "sensor_pose", "touch_success")
"""Arrays of a dataset that touches are read from."""


@dataclass(frozen=True)
class Observation:
    """Hold the image and touches of one object."""

    image: np.ndarray | None  # (rows, cols, 3) uint8; None for networks without image
    touches: tuple[Touch, ...] = ()  # what all sensors of all given grasps feel, world, m
    camera: np.ndarray | None = None  # (3, 4) world, m, to image pixels; None without one, or if it is the training's
    scale: float = 1.0  # about the centre of the network's ball; makes the object as large as those learned from
    turn: float = 0.0  # rad, about +z through that centre, before the network sees it

    def placement(self, centre: Sequence[float] | np.ndarray) -> np.ndarray:
        """Compute the similarity (4, 4) about a point (3,), world, m, that moves the object to where the network sees it."""
        turn = np.eye(4)
        turn[:3, :3] = rotation_from_euler((0, 0, self.turn))
        turn[:3, 3] = centre - turn[:3, :3] @ np.asarray(centre)
        return scaling_about(centre, self.scale) @ turn

    def scaled(self, centre: Sequence[float] | np.ndarray) -> "Observation":
        """Scale and turn the object with its touches and its camera about a point (3,), world, m, so that the image stays the same."""
        if self.scale == 1 and self.turn == 0:
            return self
        return replace(self.moved(self.placement(centre)), scale=1.0, turn=0.0)

    def moved(self, motion: np.ndarray) -> "Observation":
        """Move the object with its touches and its camera by a similarity (4, 4), m, so that the image stays the same."""
        camera = None if self.camera is None else moved_projection(self.camera, motion)
        return replace(self, touches=tuple(touch.moved(motion) for touch in self.touches), camera=camera)

    @property
    def touched(self) -> np.ndarray:
        """(T,) bool: which sensors touch."""
        return touched_flags(self.touches)


def observed_arrays(config: NetworkInputs, *, of_gels: bool = False) -> tuple[str, ...]:
    """Name the arrays of a dataset that a network is given; `of_gels` as of `stored_observation`."""
    camera = [] if config.image is None else ["rendering_camera" if config.image == "rendering" else "projection"]
    return (*stored_images(config), *camera, *stored_touches(config, of_gels=of_gels))


def stored_touches(config: NetworkInputs, *, of_gels: bool = False) -> tuple[str, ...]:
    """Name the arrays of the touches that a network is given: touch charts, or depth maps."""
    return () if not config.touch else CHART_ARRAYS if config.takes_charts and not of_gels else GEL_ARRAYS


def stored_images(config: NetworkInputs) -> tuple[str, ...]:
    """Name the arrays of the images that a network may be given."""
    if config.image == "any":
        return ("occluded", "unoccluded")
    return () if config.image is None else (config.image,)


def stored_observation(
    rows: ObjectRows,  # hold the arrays that `observed_arrays` names
    object_id: str,
    grasps: Sequence[int],  # whose touches are given; the image is the first camera's of the first; or a viewpoint
    config: NetworkInputs,  # of a network that takes any inputs, those of this observation
    *,
    of_gels: bool = False,  # depth maps are read even if it has learned from charts: they are another sensor's
    touches_of: Callable[[str, int], Sequence[Touch]] | None = None,  # of an object and grasp; None reads them as `grasp_touches` does
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
    read_touches = touches_of or partial(grasp_touches, rows, config=config, of_gels=of_gels)
    touches = [touch for grasp in grasps for touch in read_touches(object_id, grasp)] if config.touch else []
    return Observation(image, tuple(touches), camera, scale)


def grasp_touches(rows: ObjectRows, object_id: str, grasp: int, *, config: NetworkInputs, of_gels: bool = False) -> tuple[Touch, ...]:
    """Read what the sensors feel in a grasp; `of_gels` as of `stored_observation`."""
    if config.takes_charts and not of_gels:
        vertices, stop_rule = (rows.read(name, object_id)[grasp] for name in CHART_ARRAYS)
        return chart_touches(vertices, is_surface(stop_rule))
    depth, poses, touched = (rows.read(name, object_id, grasp) for name in GEL_ARRAYS)
    return tuple(depth_touches(depth, poses, touched, rows.sensors(), scale=scale_of(rows, object_id, config), config=config))


def depth_touches(
    depth: np.ndarray,  # (sensor, rows, cols) m, as stored
    poses: np.ndarray,  # (sensor, 4, 4) sensor frame to world, m
    touched: np.ndarray,  # (sensor,)
    sensors: Sequence[Sensor],
    *,
    scale: float,  # of the object, to the size at which networks see all objects
    config: NetworkInputs,
) -> Iterator[Touch]:
    """Take points of the gels of depth maps."""
    for sensor, heights, pose, touches in zip(sensors, depth, poses, touched, strict=True):
        front, contact = np.minimum(heights.astype(np.float64), gel_surface(sensor)), pressed_pixels(heights, sensor) & touches
        yield learned_touch(gel_touch(front, contact, sensor, check_pose(pose), scale), sensor, pose, config)


def learned_touch(touch: Touch, sensor: Sensor, pose: np.ndarray, config: NetworkInputs) -> Touch:
    """Give a network that has learned from charts the free points that these have: undeformed squares of sensors without touch."""
    if not config.takes_charts:
        return touch
    if touch.touched:
        return replace(touch, free=touch.free[:0], free_normals=touch.free[:0])
    square = sensor_to_world(pose, *(chart_square(config.side, sensor.aspect)[0].numpy() * sensor.width).T)
    return chart_touches(square[None], np.zeros(1, bool))[0]


def stored_cameras(rows: ObjectRows, object_id: str, config: NetworkInputs) -> np.ndarray:
    """Read the projection matrices (view, 3, 4) of an object's images, scaled with the object to the size that networks learn."""
    scale, matrices = scale_of(rows, object_id, config), rows.read("projection", object_id, camera=0)
    return np.array([Observation(None, camera=matrix, scale=scale).scaled(config.centre).camera for matrix in matrices])


def scale_of(rows: ObjectRows, object_id: str, config: NetworkInputs) -> float:
    """Compute the factor that makes an object as large as those that networks learn, 1 for objects that were scaled to 0.5 m."""
    return 2 * config.radius / rows.diagonal(object_id)


@dataclass(frozen=True)
class ChartBatch:
    """Observations as the arguments of a network that deforms charts, on its device."""

    images: Tensor | None
    camera: Tensor | None
    touch_vertices: Tensor
    touched: Tensor
    counts: list[int]


@dataclass(frozen=True)
class PointBatch:
    """Observations as the arguments of a network that takes touched points, on its device."""

    images: Tensor | None
    camera: Tensor | None
    touches: TouchPoints


def stack_observations(
    observations: Sequence[Observation],  # one per item; they are scaled to the size that the network learned
    config: NetworkInputs,  # if it takes any image, items without one get black ones, and zeros for a camera
    camera: Tensor | None,  # (3, 4) projection matrix of images without their own; None if each has its own
    like: Tensor,
) -> ChartBatch | PointBatch:
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
    of_items = [observation.touches if config.touch else () for observation in observations]
    if config.of_points:
        return PointBatch(images, cameras, pad_touches(of_items, like))
    touches, size = [touch for touches in of_items for touch in touches], config.side**2
    vertices = [touch.chart for touch in touches if touch.chart is not None and len(touch.chart) == size]
    if len(vertices) < len(touches):
        raise InvalidInput(f"the network takes touch charts of {size} vertices; some touches have none, or others")
    charts = np.stack(vertices) if vertices else np.zeros((0, size, 3), np.float32)
    touched = torch.from_numpy(touched_flags(touches)).to(like.device)
    return ChartBatch(images, cameras, torch.from_numpy(charts).to(like), touched, [len(touches) for touches in of_items])

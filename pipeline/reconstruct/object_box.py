"""Find the object of an observation: the bounding box that its network takes it to be in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, uniform_filter

from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.vision.view_transfer import camera_direction, moved_projection, optical_centre, split_projection
from pipeline.reconstruct.model_inputs import ModelInputs, learned_size
from pipeline.reconstruct.observation_file import ObservedTouch, RobotObservation

BY_DEPTH = "estimated from depth and mask"
FEW = 10
"""Pixels with a depth below which an object is not located by them."""
OUTLIERS = 1.0
"""Percentage of the points at each side of a box around them that are left out: some depths are wrong."""

CHANGED, CONTACT_SHARE = 8, 0.5
"""Levels by which a share of a tactile image's pixels, per cent, differs from the untouched image if something touches."""
SMOOTHED = 1 / 33
"""Share of a tactile image's shorter side over which differences are averaged before: noise of single pixels is no touch."""


@dataclass(frozen=True)
class ObjectBox:
    """Hold the place of an object: centre (3,) and diagonal of its bounding box, m (None if not known), and the source of both."""

    centre: NDArray[np.float64]
    diagonal: float | None
    source: str


def find_object(observation: RobotObservation, model: ModelInputs | None) -> ObjectBox | None:
    """Find the object: as the observation states it, else by its depth image, else by its touches.

    Notes
    -----
    The box has the axes of the network's world (`network_axes`), in which its training objects were placed by their boxes. Of a depth
    image, it is the box around the visible points and the same points moved backwards: what is hidden is taken to be as thick as what is
    visible along its thinnest axis. For a ball, its middle is a quarter of the radius from the true one; `python -m
    benchmarks.observed_sizes` measures it for others. Touches are the middle of the box around the gels; there must be two. Those that are
    `auto` count if their images differ from the untouched one, or if there is none.
    """
    stated, unit = observation.object, observation.metres_per_unit
    diagonal = None if stated.diagonal is None else stated.diagonal * unit
    if stated.centre is not None and diagonal is not None:
        return ObjectBox(np.array(stated.centre) * unit, diagonal, "as stated")
    visible = _visible_box(observation, model)
    if stated.centre is not None:
        return ObjectBox(np.array(stated.centre) * unit, visible[1] if visible else None, "as stated")
    if visible is not None:
        return ObjectBox(visible[0], diagonal or visible[1], BY_DEPTH)
    felt = [place for place, touch in zip(gel_centres(observation), observation.touches, strict=True) if shows_touch(touch, observation)]
    if len(felt) < 2:
        return None
    axes = network_axes(observation, model, np.mean(felt, axis=0))
    low, high = np.min(felt @ axes.T, axis=0), np.max(felt @ axes.T, axis=0)
    return ObjectBox((low + high) / 2 @ axes, diagonal, "estimated from the touches")


def shows_touch(touch: ObservedTouch, observation: RobotObservation) -> bool:
    """Decide whether a touch counts: as it is stated, or by its image's difference from the untouched one, if there is one."""
    if touch.touched != "auto" or observation.untouched is None:
        return touch.touched is not False
    change = touch.tactile_image.astype(np.float32) - observation.untouched
    side = max(3, round(SMOOTHED * min(change.shape[:2])))
    changes = np.abs(uniform_filter(change, (side, side, 1))).max(axis=2)
    return bool(np.percentile(changes, 100 - CONTACT_SHARE) >= CHANGED)


def _visible_box(observation: RobotObservation, model: ModelInputs | None) -> tuple[NDArray[np.float64], float] | None:
    camera, matrix = observation.camera, observation.projection
    if camera is None or matrix is None or camera.metres is None or camera.mask is None:
        return None
    measured, sides = camera.object_pixels & ~np.isnan(camera.metres), [OUTLIERS, 100 - OUTLIERS]
    if (inner := binary_erosion(measured)).sum() >= FEW:  # at the rim cameras mix depths with those behind
        near, far = np.percentile(camera.metres[inner], sides)
        measured &= np.abs(camera.metres - (near + far) / 2) <= 1.5 * (far - near)
    if measured.sum() < FEW:
        return None
    row, col = np.nonzero(measured)
    k, depth = camera.intrinsics, camera.metres[measured]
    seen = np.column_stack([(col + 0.5 - k.cx) / k.fx * depth, (row + 0.5 - k.cy) / k.fy * depth, depth])  # camera frame, as OpenCV's
    rotation, thinnest = split_projection(matrix)[1], np.linalg.eigh(np.cov(seen.T))[1][:, 0]
    points, behind = optical_centre(matrix) + seen @ rotation, rotation[2] * float(np.ptp(np.percentile(seen @ thinnest, sides)))
    axes = network_axes(observation, model, points.mean(axis=0))
    low, high = np.percentile(points @ axes.T, sides, axis=0)
    low, high = np.minimum(low, low + axes @ behind), np.maximum(high, high + axes @ behind)
    return (low + high) / 2 @ axes, float(np.linalg.norm(high - low))


def size_factor(box: ObjectBox, model: ModelInputs) -> float:
    """Compute the factor that scales an object to the size at which a model sees all objects; an unknown size is that of `learned_size`."""
    return 2 * model.config.radius / (learned_size(model) if box.diagonal is None else box.diagonal)


def gel_centres(observation: RobotObservation) -> NDArray[np.float64]:
    """Compute the middles of the gels' fronts, (T, 3) m."""
    thickness = observation.sensor.w if observation.sensor else 0.0
    return transform_points(observation.sensor_poses, np.array([[0.0, 0.0, thickness]]))[:, 0]


def network_axes(observation: RobotObservation, model: ModelInputs | None, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the rotation (3, 3) from the observation's frame to a network's world.

    It turns the observation's up to +z, and about +z until the camera, seen from a point (3,), m, has the azimuth of the training's.
    Without one of the two cameras, or without a network, the observation keeps its own axes but for up.
    """
    upright = turn_to_z(np.array(observation.up))
    if observation.projection is None or model is None or model.camera is None:
        return upright
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = upright, -upright @ point
    azimuth = camera_direction(moved_projection(observation.projection, motion), np.zeros(3)).azimuth
    angle = camera_direction(model.camera, np.array(model.config.centre)).azimuth - azimuth
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ upright


def turn_to_z(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the smallest rotation (3, 3) that turns a direction (3,) to +z."""
    x, y, z = (scaled := up / np.abs(up).max()) / np.linalg.norm(scaled)
    if z < 0 and (across := x * x + y * y) < 1e-300:
        return np.diag([1.0, -1, -1])
    share = 1 / (1 + z) if z >= 0 else (1 - z) / across  # both are the same: near z = -1 the former loses its digits
    return np.array([[1 - share * x * x, -share * x * y, -x], [-share * x * y, 1 - share * y * y, -y], [x, y, z]])

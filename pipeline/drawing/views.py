"""Cameras around a grasp, and pictures of single meshes."""

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.vision.camera import Camera, Vector, camera_pose, look_at, project_points, projection_matrix
from pipeline.kernels.vision.scene import Label, Scene
from pipeline.kernels.vision.view_transfer import camera_direction
from stages.render_vision.renderer import Renderer

AZIMUTHS, ELEVATIONS = np.deg2rad(np.arange(-180, 180, 45)), np.deg2rad([25.0, -15.0])
"""Directions from which a second camera is chosen; a low one shows what the fingers do below."""
MIN_TURN = np.deg2rad(40.0)  # least angle between the second view and the first
FILL = 0.92  # share of the image's side that the subject takes up


def render_mesh(renderer: Renderer, mesh: Mesh, camera: Camera | None = None) -> NDArray[np.uint8]:  # (rows, cols, 3)
    """Render a mesh alone, with a camera or the renderer's own."""
    with renderer.added(mesh, Label.OBJECT) as handle:
        return renderer.render_colors([(handle, np.eye(4))], camera)


def fitted_camera(
    camera: Camera,
    points: Array,  # (N, 3) world, m
    fill: float = FILL,
) -> Camera:
    """Turn a camera to the middle of points and let them fill a share of its image.

    It keeps its position, or goes back until it is clear of them. One straight above them keeps the top of its image.
    """
    target, size = _box(points)
    direction = camera_direction(projection_matrix(camera), target)
    away = max(1.0, float(np.linalg.norm(size)) / direction.distance)
    position = _vector(target + away * (np.array(camera.position) - target))
    rotation = (90 - math.degrees(direction.elevation), 0.0, 90 + math.degrees(direction.azimuth))
    return zoomed(camera.model_copy(update={"position": position, "rotation": rotation}), points, fill)


def zoomed(
    camera: Camera,
    points: Array,  # (N, 3) world, m
    fill: float = FILL,
) -> Camera:
    """Give a camera the focal length at which points fill its image."""
    reach = np.abs(project_points(projection_matrix(camera), points) - np.array(camera.centre)).max()
    return camera.zoomed(fill * camera.resolution / 2 / float(reach))


def cameras_around(
    camera: Camera,
    points: Array,  # (N, 3) world, m
) -> list[Camera]:
    """Place cameras on all sides of points, except near the given one, and zoom them to the points."""
    front = np.array(camera.position) - _box(points)[0]
    sides = [np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) for e in ELEVATIONS for a in AZIMUTHS]
    turned = [side for side in sides if side @ front < np.cos(MIN_TURN) * np.linalg.norm(front)]
    return [zoomed(towards(camera, points, side), points) for side in turned]


def towards(
    camera: Camera,
    points: Array,  # (N, 3) world, m
    direction: Array,  # (3,) unit
) -> Camera:
    """Move a camera to a direction from the middle of points, at its own distance but clear of them."""
    target, size = _box(points)
    distance = max(np.linalg.norm(np.array(camera.position) - target), np.linalg.norm(size))
    return look_at(camera, _vector(target + distance * direction), _vector(target))


def lamp_beside(scene: Scene, camera: Camera) -> Vector:
    """Move the lamp with the camera: an image from behind is lit as one from the front."""
    carried = camera_pose(camera) @ np.linalg.inv(camera_pose(scene.camera)) @ np.array([*scene.lamp.position, 1.0])
    return _vector(carried[:3])


def _box(points: Array) -> tuple[Array, Array]:  # (3,) middle, (3,) size
    lowest, highest = points.min(axis=0), points.max(axis=0)
    return (lowest + highest) / 2, highest - lowest


def _vector(coordinates: Array) -> Vector:
    x, y, z = coordinates.tolist()
    return x, y, z

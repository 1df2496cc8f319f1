"""Render a grasp from a second side: the hand on the object, and the object alone with the surface patch that each sensor touched."""

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pipeline.drawing.contact_sheet_page import Color
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.touch.depth_maps import in_gel
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.kernels.vision.camera import Camera, Vector, camera_pose, look_at, project_points, projection_matrix
from pipeline.kernels.vision.scene import Label, Scene
from pipeline.kernels.vision.view_transfer import camera_direction
from stages.render_vision.renderer import MeshHandle, PosedMesh, Renderer

AZIMUTHS = np.deg2rad(np.arange(-180, 180, 45))
ELEVATIONS = np.deg2rad([25.0, -15.0])
"""Directions around the object from which the second camera is chosen; a low one shows what the fingers do below."""

MIN_TURN = np.deg2rad(40.0)
"""Least angle between the second view and the first."""

TRIAL_RESOLUTION = 48
"""Pixels per side of the images that decide between the directions: enough to count what they show."""

FILL = 0.92
"""Share of the image's side that the subject takes up."""

STRIDE = 3
"""Every `STRIDE`-th pixel of a sensor becomes a vertex of its patch."""

SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
"""The corners of a gel, in half sides."""

LINE, RIM = 1.5, 2.5
"""Width of a square's outline, and of the white rim under it, pixels."""

LIFT = 4e-4
"""Distance of a patch in front of the surface it marks, m: it stays visible over a coarse mesh between its vertices."""


@dataclass(frozen=True, eq=False)
class GraspView:
    """Hold the content of the second view of one grasp, world frame, m."""

    object_mesh: tuple[MeshHandle, Mesh]  # as the renderer knows it, and the mesh
    hand: Sequence[tuple[MeshHandle, Mesh, NDArray[np.float64]]]  # as the renderer knows them; (V, 3); (4, 4) poses
    patches: Sequence[Mesh]  # the surface that each sensor touched (see `touch_patch`), in its colour
    palm: NDArray[np.float64]  # (3,) direction to which the palm faces: seen across it, fingers show what they do
    squares: NDArray[np.float64]  # (S, 4, 3) corners of the gels, drawn over both images to mark what hides a patch
    colors: Sequence[Color]  # (S,) sRGB of the sensors


def grasp_cameras(renderer: Renderer, scene: Scene, resolution: int, grasp: GraspView) -> tuple[Camera, Camera]:
    """Choose the cameras of a second view of a grasp by rendering trials; the scene gives the first camera.

    One is close to the hand, from another side; one in its direction sees the whole object.
    """
    camera = scene.square_camera(resolution)
    handle, mesh = grasp.object_mesh
    posed_object: PosedMesh = (handle, np.eye(4))
    posed_hand: list[PosedMesh] = [(hand, pose) for hand, _, pose in grasp.hand]
    corners = grasp.squares.reshape(-1, 3)
    grip = np.vstack([*(transform_points(pose, hand.vertices) for _, hand, pose in grasp.hand), corners])
    views = [_zoomed(view, grip) for view in _around(camera, grip)]
    near = max(
        views,
        key=lambda view: _score(renderer, view.with_resolution(TRIAL_RESOLUTION), [posed_object, *posed_hand]) * _across(view, grasp.palm),
    )
    return near, _zoomed(_towards(camera, mesh.vertices, camera_pose(near)[:3, 2]), np.vstack([mesh.vertices, corners]))


def second_view(
    renderer: Renderer,
    scene: Scene,
    cameras: tuple[Camera, Camera],  # of `grasp_cameras`
    grasp: GraspView,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:  # (R, R, 3): the hand, close by; the object alone, with touch sites
    """Render a grasp from another side, with the lamp moved along with the camera."""
    near, far = cameras
    posed_object: PosedMesh = (grasp.object_mesh[0], np.eye(4))
    posed_hand: list[PosedMesh] = [(hand, pose) for hand, _, pose in grasp.hand]
    with ExitStack() as added:
        marks: list[PosedMesh] = [(added.enter_context(renderer.added(patch, Label.HAND)), np.eye(4)) for patch in grasp.patches]
        views_of = (([posed_object, *posed_hand], near), ([posed_object, *marks], far))
        close_image, far_image = (renderer.render(meshes, view, lamp_beside(scene, view)).rgb for meshes, view in views_of)
    return _outlined(close_image, near, grasp.squares, grasp.colors), _outlined(far_image, far, grasp.squares, grasp.colors)


def touch_patch(
    depth: NDArray[np.float32],  # (rows, cols) m
    pose: NDArray[np.float64],  # (4, 4) sensor frame to world frame
    sensor: Sensor,  # gives the pixels' positions and the thickness of the gel
    color: Color,  # sRGB
) -> Mesh | None:
    """Make a mesh of the surface in a sensor's gel, `LIFT` in front of it; None if the gel is empty."""
    x, y = (centres[::STRIDE] for centres in pixel_centres(sensor))
    sampled = depth[::STRIDE, ::STRIDE].astype(np.float64)
    inside = in_gel(depth.astype(np.float64), sensor)[::STRIDE, ::STRIDE]
    local = np.stack([*np.meshgrid(x, y), np.where(inside, sampled - LIFT, 0)], axis=-1).reshape(-1, 3)
    number = np.arange(local.shape[0]).reshape(inside.shape)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    quads = quads[inside.reshape(-1)[quads].all(axis=1)]
    if not len(quads):
        return None
    faces = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    return Mesh(transform_points(pose, local), faces, Look.plain(len(local), len(faces), color))


def gel_squares(poses: NDArray[np.float64], sensors: Sequence[Sensor]) -> NDArray[np.float64]:
    """Compute the (S, 4, 3) corners, world frame, m, of the gels' front faces from the sensors' poses (S, 4, 4)."""
    corners = [[(x * sensor.width / 2, y * sensor.height / 2, sensor.w) for x, y in SQUARE] for sensor in sensors]
    return transform_points(poses, np.array(corners))


def _around(camera: Camera, points: NDArray[np.float64]) -> list[Camera]:
    """Location cameras on all sides of `points` (N, 3), m, except near the given one."""
    front = np.array(camera.position) - _box(points)[0]
    sides = [np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) for e in ELEVATIONS for a in AZIMUTHS]
    return [_towards(camera, points, side) for side in sides if side @ front < np.cos(MIN_TURN) * np.linalg.norm(front)]


def _towards(
    camera: Camera,
    points: NDArray[np.float64],  # (N, 3) m
    direction: NDArray[np.float64],  # (3,) unit
) -> Camera:
    """Move the camera to this direction from the middle of `points`, at its own distance but clear of them."""
    target, size = _box(points)
    distance = max(np.linalg.norm(np.array(camera.position) - target), np.linalg.norm(size))
    return look_at(camera, _vector(target + distance * direction), _vector(target))


def _box(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute the middle and the size (3,) of the bounding box of points (N, 3)."""
    lowest, highest = points.min(axis=0), points.max(axis=0)
    return (lowest + highest) / 2, highest - lowest


def _vector(coordinates: NDArray[np.float64]) -> Vector:
    x, y, z = coordinates.tolist()
    return x, y, z


def lamp_beside(scene: Scene, camera: Camera) -> Vector:
    """Move the lamp with the camera: an image from behind is lit as one from the front."""
    carried = camera_pose(camera) @ np.linalg.inv(camera_pose(scene.camera)) @ np.array([*scene.lamp.position, 1.0])
    return _vector(carried[:3])


def fitted_camera(camera: Camera, points: NDArray[np.float64], fill: float = FILL) -> Camera:
    """Turn a camera to the middle of `points` (N, 3), world frame, m, and let them fill that share of its image.

    It keeps its position, or goes back until it is clear of them. One straight above them keeps the top of its image.
    """
    target, size = _box(points)
    seen_from = camera_direction(projection_matrix(camera), target)
    away = max(1.0, float(np.linalg.norm(size)) / seen_from.distance)
    position = _vector(target + away * (np.array(camera.position) - target))
    rotation = (90 - math.degrees(seen_from.elevation), 0.0, 90 + math.degrees(seen_from.azimuth))
    return _zoomed(camera.model_copy(update={"position": position, "rotation": rotation}), points, fill)


def _zoomed(camera: Camera, points: NDArray[np.float64], fill: float = FILL) -> Camera:
    """Give the camera the focal length at which `points` (N, 3), m, fill its image."""
    reach = np.abs(project_points(projection_matrix(camera), points) - np.array(camera.centre)).max()
    zoom = fill * camera.resolution / 2 / float(reach)
    return camera.model_copy(update={"focal": (camera.focal[0] * zoom, camera.focal[1] * zoom)})


def _score(renderer: Renderer, camera: Camera, meshes: Sequence[PosedMesh]) -> float:
    """Score how much of both object and hand an image shows, by the product of their areas, square pixels."""
    segmentation = renderer.segment(meshes, camera)
    return float((segmentation == Label.OBJECT).sum()) * float((segmentation == Label.HAND).sum())


def _across(camera: Camera, palm: NDArray[np.float64]) -> float:
    """Compute sin² of the angle between viewing direction and palm (3,): 1 from the hand's side, 0 from its back."""
    return 1 - float(camera_pose(camera)[:3, 2] @ palm) ** 2


def _outlined(image: NDArray[np.uint8], camera: Camera, squares: NDArray[np.float64], colors: Sequence[Color]) -> NDArray[np.uint8]:
    """Draw the sensors' squares (S, 4, 3) over an image: smooth lines in their colours on a white rim."""
    fine = 4  # Pillow draws no smooth lines: drawn four times as large and averaged
    side = image.shape[0] * fine
    canvas = Image.fromarray(image).resize((side, side), Image.Resampling.NEAREST)
    pencil = ImageDraw.Draw(canvas)
    matrix = projection_matrix(camera)
    lines = [[*corners, corners[0], corners[1]] for corners in (project_points(matrix, square) * fine for square in squares)]
    for line, color in zip(lines, colors, strict=True):
        for ink, wide in (((255, 255, 255), RIM), (color, LINE)):
            pencil.line([(float(u), float(v)) for u, v in line], fill=ink, width=round(wide * fine), joint="curve")
    return np.asarray(canvas.resize((image.shape[1], image.shape[0]), Image.Resampling.BOX))

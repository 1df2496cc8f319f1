"""A grasp from where it shows best: the hand on the object, and the object alone with the patches that each sensor felt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import Camera, Vector, look_at, pose, project, projection_matrix
from pipeline.kernels.vision.scene import Scene
from pipeline.kernels.vision.view import Label, Part, Placed, Renderer

Color = tuple[int, int, int]

AZIMUTHS = np.deg2rad(np.arange(-180, 180, 45))
ELEVATIONS = np.deg2rad([25.0, -15.0])
"""Where the camera may stand around the object: a low view shows what the fingers do below."""

AWAY = np.deg2rad(40.0)
"""The second view leaves at least this angle to the first, or it would be the first again."""

TRIAL = 48
"""Pixels a side of the images that decide between the views: enough to count what they show."""

FILL = 0.92
"""Share of the image's side that what is shown takes up."""

STRIDE = 3
"""Every so many of a sensor's pixels become a vertex of its patch."""

LINE, RIM = 1.5, 2.5
"""Width of a square's outline, and of the white rim under it, pixels."""

LIFT = 4e-4
"""How far a patch lies before the surface it marks, m: enough to win over a coarse mesh between its vertices."""


def second_side(
    renderer: Renderer,
    scene: Scene,
    resolution: int,
    thing: tuple[Part, Mesh],
    hand: Sequence[tuple[Part, Mesh, NDArray[np.float64]]],
    patches: Sequence[Mesh],
    palm: NDArray[np.float64],
    squares: NDArray[np.float64],
    colors: Sequence[Color],
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Two images, (R, R, 3) uint8, from one side: the hand close by, and the whole object alone with its touch sites.

    Parameters
    ----------
    renderer, scene, resolution
        The first view's; the second is taken from another side, the lamp moved along with the camera.
    thing
        The object, as `renderer` knows it, and its mesh, in the world.
    hand
        The hand's shapes, as `renderer` knows them, their meshes, and the frame (4, 4) of each in the world.
    patches
        What each sensor felt (see `patch`), in its colour.
    palm
        (3,) the direction, world, to which the palm faces: seen across it, fingers show what they do.
    squares
        (S, 4, 3) corners of the sensors' squares, world, m: they are drawn over both images, for what hides a patch.
    colors
        (S,) sRGB of each sensor.
    """
    camera = scene.camera.at(resolution)
    whole: Placed = (thing[0], np.eye(4))
    held: list[Placed] = [(part, frame) for part, _, frame in hand]
    grip = np.vstack([*(mesh.vertices @ frame[:3, :3].T + frame[:3, 3] for _, mesh, frame in hand), squares.reshape(-1, 3)])
    views = [_zoomed(view, grip) for view in _around(camera, grip)]
    near = max(views, key=lambda view: _shown(renderer, view.at(TRIAL), [whole, *held]) * _across(view, palm))
    far = _zoomed(_towards(camera, thing[1].vertices, pose(near)[:3, 2]), np.vstack([thing[1].vertices, squares.reshape(-1, 3)]))
    marks: list[Placed] = [(renderer.add(mesh, Label.HAND), np.eye(4)) for mesh in patches]
    try:
        images = [renderer.render(parts, view, _lamp(scene, view)).rgb for parts, view in (([whole, *held], near), ([whole, *marks], far))]
    finally:
        for part, _ in marks:
            renderer.remove(part)
    return _outlined(images[0], near, squares, colors), _outlined(images[1], far, squares, colors)


def patch(depth: NDArray[np.float32], frame: NDArray[np.float64], width: float, gel: float, color: Color) -> Mesh | None:
    """The surface in a sensor's gel as a mesh of the world, a hair before the surface; None where the gel is empty.

    `depth` (H, W) m, the sensor's `frame` (4, 4), its square's `width` and its `gel`'s thickness, m.
    """
    rows, cols = (np.arange(0, size, STRIDE) for size in depth.shape)
    sampled = depth[np.ix_(rows, cols)].astype(np.float64)
    inside = sampled < gel
    x, y = (cols + 0.5) / depth.shape[1] - 0.5, (rows + 0.5) / depth.shape[0] - 0.5
    local = np.stack([*np.meshgrid(x * width, y * width), np.where(inside, sampled - LIFT, 0)], axis=-1).reshape(-1, 3)
    number = np.arange(local.shape[0]).reshape(inside.shape)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    quads = quads[inside.reshape(-1)[quads].all(axis=1)]
    if not len(quads):
        return None
    faces = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    return Mesh(local @ frame[:3, :3].T + frame[:3, 3], faces, Look.plain(len(local), len(faces), color))


def squares_of(poses: NDArray[np.float64], width: float, gel: float) -> NDArray[np.float64]:
    """(S, 4, 3) corners in the world of the gels' front squares, from the sensors' frames (S, 4, 4), m."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * width / 2
    local = np.column_stack([corners, np.full(4, gel)])
    return np.asarray(np.einsum("sij,cj->sci", poses[:, :3, :3], local) + poses[:, None, :3, 3])


def _around(camera: Camera, points: NDArray[np.float64]) -> list[Camera]:
    """Cameras on all sides of `points`, none near the first."""
    first = np.array(camera.position) - (points.min(axis=0) + points.max(axis=0)) / 2
    found = []
    for elevation in ELEVATIONS:
        for azimuth in AZIMUTHS:
            flat = np.cos(elevation)
            away = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
            if away @ first < np.cos(AWAY) * np.linalg.norm(first):
                found.append(_towards(camera, points, away))
    return found


def _towards(camera: Camera, points: NDArray[np.float64], away: NDArray[np.float64]) -> Camera:
    """The camera as far from the middle of `points` as it is, but clear of them, in the direction `away` (unit) from it."""
    lowest, highest = points.min(axis=0), points.max(axis=0)
    target = (lowest + highest) / 2
    distance = max(np.linalg.norm(np.array(camera.position) - target), np.linalg.norm(highest - lowest))
    x, y, z = (target + distance * away).tolist()
    return look_at(camera, (x, y, z), (float(target[0]), float(target[1]), float(target[2])))


def _lamp(scene: Scene, camera: Camera) -> Vector:
    """Where the lamp stands if it goes with the camera: a picture from behind is lit as one from the front."""
    carried = pose(camera) @ np.linalg.inv(pose(scene.camera)) @ np.array([*scene.lamp.position, 1.0])
    return float(carried[0]), float(carried[1]), float(carried[2])


def _zoomed(camera: Camera, points: NDArray[np.float64]) -> Camera:
    """The camera with the focal length at which `points` fill its image."""
    reach = np.abs(project(projection_matrix(camera), points) - np.array(camera.centre)).max()
    zoom = FILL * camera.resolution / 2 / float(reach)
    return camera.model_copy(update={"focal": (camera.focal[0] * zoom, camera.focal[1] * zoom)})


def _shown(renderer: Renderer, camera: Camera, parts: Sequence[Placed]) -> float:
    """How much an image shows of both object and hand: the product of their areas, square pixels."""
    segmentation = renderer.render(parts, camera).segmentation
    return float((segmentation == Label.OBJECT).sum()) * float((segmentation == Label.HAND).sum())


def _across(camera: Camera, palm: NDArray[np.float64]) -> float:
    """sin² of the angle between viewing direction and palm: 1 where the hand is seen from its side, 0 from its back."""
    return 1 - float(pose(camera)[:3, 2] @ palm) ** 2


def _outlined(image: NDArray[np.uint8], camera: Camera, squares: NDArray[np.float64], colors: Sequence[Color]) -> NDArray[np.uint8]:
    """The image with the sensors' squares drawn over it, smooth lines in their colours on a white rim."""
    fine = 4  # Pillow draws no smooth lines: drawn four times as large and averaged
    side = image.shape[0] * fine
    canvas = Image.fromarray(image).resize((side, side), Image.Resampling.NEAREST)
    pencil = ImageDraw.Draw(canvas)
    matrix = projection_matrix(camera)
    for square, color in zip(squares, colors, strict=True):
        corners = [(float(u), float(v)) for u, v in project(matrix, square) * fine]
        for ink, wide in (((255, 255, 255), RIM), (color, LINE)):
            pencil.line([*corners, corners[0], corners[1]], fill=ink, width=round(wide * fine), joint="curve")
    return np.asarray(canvas.resize((image.shape[1], image.shape[0]), Image.Resampling.BOX))

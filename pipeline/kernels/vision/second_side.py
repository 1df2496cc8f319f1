"""A grasp from where it shows best: the hand on the object, and the object alone with the patches that each sensor felt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import Camera, look_at, project, projection_matrix
from pipeline.kernels.vision.view import Label, Placed, Renderer

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

LIFT = 4e-4
"""How far a patch lies before the surface it marks, m: enough to win over a coarse mesh between its vertices."""


def second_side(
    renderer: Renderer,
    camera: Camera,
    thing: Placed,
    hand: Sequence[Placed],
    points: NDArray[np.float64],
    patches: Sequence[Mesh],
    squares: NDArray[np.float64],
    colors: Sequence[Color],
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Two images, (R, R, 3) uint8: the hand on the object, and the object alone with its touch sites.

    Parameters
    ----------
    renderer, thing, hand
        The object and the hand's shapes, as `renderer` knows them, where they stand.
    camera
        The first view; the second has its resolution and looks from another side.
    points
        (N, 3) what shall be in the picture, world, m: the object's vertices, the links' origins and the sensors' corners.
    patches
        What each sensor felt (see `patch`), in its colour.
    squares
        (S, 4, 3) corners of the sensors' squares, world, m: they are drawn over both images, for what hides a patch.
    colors
        (S,) sRGB of each sensor.
    """
    best = max(_candidates(camera, points), key=lambda view: _shown(renderer, view.at(TRIAL), thing, hand))
    held = renderer.render([thing, *hand], best).rgb
    marks = [(renderer.add(mesh, Label.HAND), np.eye(4)) for mesh in patches]
    try:
        felt = renderer.render([thing, *marks], best).rgb
    finally:
        for part, _ in marks:
            renderer.remove(part)
    return _outlined(held, best, squares, colors), _outlined(felt, best, squares, colors)


def patch(depth: NDArray[np.float32], pose: NDArray[np.float64], width: float, gel: float, color: Color) -> Mesh | None:
    """The surface in a sensor's gel as a mesh of the world, a hair before the surface; None where the gel is empty.

    `depth` (H, W) m, the sensor's frame `pose` (4, 4), its square's `width` and its `gel`'s thickness, m.
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
    return Mesh(local @ pose[:3, :3].T + pose[:3, 3], faces, Look.plain(len(local), len(faces), color))


def squares_of(poses: NDArray[np.float64], width: float, gel: float) -> NDArray[np.float64]:
    """(S, 4, 3) corners in the world of the gels' front squares, from the sensors' frames (S, 4, 4), m."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * width / 2
    local = np.column_stack([corners, np.full(4, gel)])
    return np.asarray(np.einsum("sij,cj->sci", poses[:, :3, :3], local) + poses[:, None, :3, 3])


def _candidates(camera: Camera, points: NDArray[np.float64]) -> list[Camera]:
    """Cameras around the middle of `points` that see all of them as large as they can, none near the first."""
    lowest, highest = points.min(axis=0), points.max(axis=0)
    middle = (lowest + highest) / 2
    first = np.array(camera.position) - middle
    distance = float(np.linalg.norm(first))
    found = []
    for elevation in ELEVATIONS:
        for azimuth in AZIMUTHS:
            flat = np.cos(elevation)
            away = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
            if away @ first < np.cos(AWAY) * distance:
                x, y, z = (middle + distance * away).tolist()
                view = look_at(camera, (x, y, z), (float(middle[0]), float(middle[1]), float(middle[2])))
                found.append(_zoomed(view, points))
    return found


def _zoomed(camera: Camera, points: NDArray[np.float64]) -> Camera:
    """The camera with the focal length at which `points` fill its image."""
    reach = np.abs(project(projection_matrix(camera), points) - np.array(camera.centre)).max()
    zoom = FILL * camera.resolution / 2 / float(reach)
    return camera.model_copy(update={"focal": (camera.focal[0] * zoom, camera.focal[1] * zoom)})


def _shown(renderer: Renderer, camera: Camera, thing: Placed, hand: Sequence[Placed]) -> float:
    """How much an image shows of both object and hand: the product of their areas, square pixels."""
    segmentation = renderer.render([thing, *hand], camera).segmentation
    return float((segmentation == Label.OBJECT).sum()) * float((segmentation == Label.HAND).sum())


def _outlined(
    image: NDArray[np.uint8], camera: Camera, squares: NDArray[np.float64], colors: Sequence[Color]
) -> NDArray[np.uint8]:
    """The image with the sensors' squares drawn over it, smooth lines in their colours on a white rim."""
    fine = 4  # Pillow draws no smooth lines: drawn four times as large and averaged
    side = image.shape[0] * fine
    canvas = Image.fromarray(image).resize((side, side), Image.Resampling.NEAREST)
    pencil = ImageDraw.Draw(canvas)
    matrix = projection_matrix(camera)
    for square, color in zip(squares, colors, strict=True):
        corners = [(float(u), float(v)) for u, v in project(matrix, square) * fine]
        for ink, wide in (((255, 255, 255), 3 * fine), (color, round(1.5 * fine))):
            pencil.line([*corners, corners[0], corners[1]], fill=ink, width=wide, joint="curve")
    return np.asarray(canvas.resize((image.shape[1], image.shape[0]), Image.Resampling.BOX))

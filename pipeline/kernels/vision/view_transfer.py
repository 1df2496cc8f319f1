"""Images as another camera would have taken them from the same position, their background, and cameras moved between positions.

Projection matrices are those of `projection_matrix`: world, m, to (column, row) in pixels, pixel centres at ½.

Valid range: cameras within 1 km of the origin, at least 1 mm from the point they look at.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from PIL import Image

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.compiled import for_few
from pipeline.kernels.geometry.transforms import compose, invert_similarity, length, solve_3x3, unit_vectors

ALIKE = 6  # levels of 255 in each colour by which the background differs at most from the image's border
UNCHANGED = 1e-3  # largest shift, pixels, at which an image is not resampled
OVERHEAD = 1e-3  # cosine of the elevation below which a camera is straight above or below; its image's top is its azimuth


def foreground(image: NDArray[np.uint8]) -> Mask:
    """Find the pixels of an image (rows, cols, 3) that do not have the colour of most of its border: (rows, cols)."""
    return np.asarray((np.abs(image - np.median(border(image), axis=0)) > ALIKE).any(axis=2))


def background_color(image: NDArray[np.uint8]) -> tuple[int, int, int]:
    """Compute the colour of most of the border of an image, (rows, cols, 3): sRGB."""
    red, green, blue = (int(level) for level in np.median(border(image), axis=0))
    return red, green, blue


def border(image: NDArray[Any]) -> NDArray[Any]:
    """Take the outermost pixels of an image (rows, cols, …): (N, …), the corners twice."""
    return np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])


class Direction(NamedTuple):
    """Where a camera is, seen from a point."""

    azimuth: float  # rad, about +z
    elevation: float  # rad, above the horizon
    distance: float  # m


def optical_centre(matrix: Array) -> Array:
    """Compute the optical centre (3,), world, m, of a projection matrix (3, 4)."""
    return -for_few(solve_3x3)(matrix[:, :3], matrix[:, 3])


def split_projection(matrix: Array) -> tuple[Array, Array]:  # (3, 3), (3, 3) world to camera: x right, y down, z forward
    """Split a projection matrix (3, 4) without skew, whose third row measures depth in m, into intrinsic matrix and rotation."""
    forward = matrix[2, :3]
    centre = matrix[:2, :3] @ forward  # column and row of the principal point
    across = matrix[:2, :3] - centre[:, None] * forward
    focal = length(across)
    intrinsic = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1.0]])
    return intrinsic, np.vstack([across / focal[:, None], forward])


def camera_direction(matrix: Array, target: Array) -> Direction:
    """Compute where the camera of a matrix (3, 4) is, seen from a point (3,); straight above or below, its image's top has the azimuth."""
    offset = optical_centre(matrix) - target
    distance, across = float(length(offset)), float(np.hypot(offset[0], offset[1]))
    elevation = float(np.arctan2(offset[2], across))
    if across < OVERHEAD * distance:
        down = split_projection(matrix)[1][1]  # of the image, in the world
        offset = down if elevation > 0 else -down
    return Direction(float(np.arctan2(offset[1], offset[0])), elevation, distance)


def moved_projection(projection: Array, motion: Array) -> Array:
    """Compute the projection matrix of a camera that moved with its frame, which may be scaled; depth stays in m."""
    moved = compose(projection, invert_similarity(motion))
    return np.asarray(moved / np.linalg.norm(moved[2, :3]))


def carried_camera(training: Array, real: Array, target: Array) -> Array:
    """Move a training camera to a real camera's position, and turn and zoom it so that it shows the target as in training.

    Cameras are projection matrices (3, 4), the target is the object's middle (3,), world, m. It is at the same pixel as in training, as
    large, and the world's up has the same direction there.

    R = R_training Lᵀ(training) L(real), where L are the axes of a camera without roll that looks at the target. The focal lengths grow by
    the ratio of the distances about the target's pixel.
    """
    intrinsic, rotation = split_projection(training)
    training_direction, real_direction = (camera_direction(matrix, target) for matrix in (training, real))
    turned = compose(compose(rotation, _level_axes(training, target).T), _level_axes(real, target))
    homogeneous = training @ np.append(target, 1.0)
    pixel, zoom = homogeneous[:2] / homogeneous[2], real_direction.distance / training_direction.distance
    zoomed = np.array([[zoom, 0, (1 - zoom) * pixel[0]], [0, zoom, (1 - zoom) * pixel[1]], [0, 0, 1.0]])
    turned_matrix = compose(compose(zoomed, intrinsic), turned)
    return np.column_stack([turned_matrix, -turned_matrix @ optical_centre(real)])


def _level_axes(matrix: Array, target: Array) -> Array:
    """Compute right, down and forward (3, 3), world, of a camera without roll that looks at a target from a camera's position."""
    azimuth = camera_direction(matrix, target).azimuth
    forward = unit_vectors(target - optical_centre(matrix))
    level = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    right = unit_vectors(level - (level @ forward) * forward)
    return np.array([right, np.cross(forward, right), forward])


def transfer_view(
    image: NDArray[np.uint8],  # (rows, cols, 3) sRGB
    real: Array,  # (3, 4) projection matrix of its camera
    other: Array,  # (3, 4) projection matrix of the other camera
    shape: tuple[int, int],  # rows and columns of the other camera's image
    fill: tuple[int, int, int],  # sRGB of pixels that the image does not show
) -> tuple[NDArray[np.uint8], float]:  # the other camera's image, and the share of it that the image shows
    """Resample an image as another camera with the same optical centre would have taken it; one that shrinks is smoothed first.

    The homography is M_real M_other⁻¹, of the first three columns. An image that would move by less than `UNCHANGED` is returned.
    """
    to_image = real[:, :3] @ np.linalg.inv(other[:, :3])
    corners = np.array([[0, 0, 1], [shape[1], 0, 1], [0, shape[0], 1], [shape[1], shape[0], 1.0]]).T
    mapped = to_image @ corners
    if image.shape[:2] == tuple(shape) and (mapped[2] > 0).all() and np.abs(mapped[:2] / mapped[2] - corners[:2]).max() < UNCHANGED:
        return image, 1.0
    shrinking = _scale(to_image, (shape[1] / 2, shape[0] / 2))
    if shrinking > 1:
        image = np.rint(scipy.ndimage.gaussian_filter(image.astype(np.float32), ((shrinking - 1) / 2,) * 2, axes=(0, 1))).astype(np.uint8)
    shown = _warp(np.full(image.shape[:2], 255, np.uint8), to_image, shape, 0)
    return _warp(image, to_image, shape, fill), float(shown.mean() / 255)


def _warp(image: NDArray[np.uint8], to_image: Array, shape: tuple[int, int], fill: Any) -> NDArray[np.uint8]:
    """Sample an image at `to_image` (3, 3) of each pixel, bilinearly, with fractions of a level cut off; `fill` is beside it."""
    coefficients = (to_image / to_image[2, 2]).ravel()[:8]
    size = shape[1], shape[0]
    moved = Image.fromarray(image).transform(size, Image.Transform.PERSPECTIVE, coefficients, Image.Resampling.BILINEAR, fillcolor=fill)
    return np.asarray(moved)  # four times as fast as with scikit-image


def _scale(homography: Array, pixel: tuple[float, float]) -> float:
    """Compute how many pixels of its target a pixel of a homography's source covers along a side."""
    u, v, w = homography @ np.array([*pixel, 1.0])
    numerators = np.array([u, v])
    slopes = (homography[:2, :2] * w - numerators[:, None] * homography[2, :2]) / w**2
    return float(np.sqrt(abs(np.linalg.det(slopes))))

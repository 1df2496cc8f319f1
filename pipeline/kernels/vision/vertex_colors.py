"""The colours of a surface in an image."""

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array, Integers, Mask
from pipeline.kernels.geometry.closed_surface import vertex_normals
from pipeline.kernels.geometry.exterior_sampling import RayScene
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import optical_centre

STEEPEST = 0.1  # cosine between normal and view below which a vertex is on the rim, where pixels may show the background
OFFSET = 1e-3  # of a ray's start from the surface over the surface's diagonal


def seen_colors(
    vertices: Array,  # (V, 3) world, m
    faces: Integers,  # (F, 3) normals outwards
    image: NDArray[np.uint8],  # (rows, cols, 3)
    matrix: Array,  # (3, 4) the image's projection matrix, from `projection_matrix`
    shown: Mask,  # (rows, cols) where the image shows the object, and no background or hand
) -> tuple[NDArray[np.uint8], Mask]:  # (V, 3) 0 where not seen, (V,)
    """Look up the colours of vertices in an image, and which are seen: those that face the camera, unoccluded, in a shown pixel."""
    rows, cols = shown.shape
    to_camera = optical_centre(matrix) - vertices
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    pixels = project_points(matrix, vertices)
    in_image = ((pixels >= 0) & (pixels < [cols, rows])).all(axis=1)  # NaN behind the camera is not
    seen = in_image & ((vertex_normals(vertices, faces) * to_camera).sum(axis=1) > STEEPEST)
    col, row = pixels[seen].astype(np.int64).T
    seen[seen] = shown[row, col]
    seen[seen] = RayScene(vertices, faces).escape(vertices[seen], to_camera[seen], OFFSET)
    colors = np.zeros((len(vertices), 3), np.uint8)
    col, row = pixels[seen].astype(np.int64).T
    colors[seen] = image[row, col]
    return colors, seen

"""The viewpoints of 3D-R2N2's renderings, and their cameras.

The renderings are Blender's, of ShapeNetCore meshes as their files have them: y up, about the origin, in units of the file.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import compose, invert_similarity, length

FOCAL, SENSOR = 35.0, 32.0
"""mm: focal length and width of the renderings' camera. The field of view in the metadata was not rendered with."""
FARTHEST = 1.75  # distance of the camera from the origin where the distance ratio is 1, units of the file


@dataclass(frozen=True)
class Viewpoint:
    """Where a rendering was made from: a line of `rendering_metadata.txt`."""

    azimuth: float  # degrees; 0 is +x, 90 is +z
    elevation: float  # degrees; 90 is straight above
    in_plane: float  # degrees, rotation about the viewing direction: 0 in all renderings
    distance: float  # over `FARTHEST`


def viewpoint_camera(
    viewpoint: Viewpoint,
    resolution: int,  # pixels per side
) -> Array:  # (3, 4)
    """Compute the projection matrix of a rendering, whose camera looks at the origin, without roll.

    It takes homogeneous points of the mesh file (y up, its units) to (column, row, 1) times depth; pixel centres at
    1/2. Depth is in units of the file.
    """
    a, e = np.deg2rad([viewpoint.azimuth, viewpoint.elevation])
    backward = np.array([np.cos(a) * np.cos(e), np.sin(e), np.sin(a) * np.cos(e)])  # from the origin to the camera
    right = np.array([np.sin(a), 0.0, -np.cos(a)])
    up = np.cross(backward, right)
    frame = np.stack([right, -up, -backward])  # columns, rows and depth
    to_camera = np.column_stack([frame, [0.0, 0.0, FARTHEST * viewpoint.distance]])  # the origin is straight ahead of the camera
    focal = FOCAL / SENSOR * resolution
    intrinsic = np.array([[focal, 0, resolution / 2], [0, focal, resolution / 2], [0, 0, 1]])
    return compose(intrinsic, to_camera)


def placed_camera(
    camera: Array,  # (3, 4) points of the mesh file to pixels
    placement: Array,  # (4, 4) points of the mesh file to the world: turned, scaled by one factor, moved
) -> Array:  # (3, 4) world points, m, to pixels; its depth is in m
    """Compute the projection matrix that shows a placed object as a camera shows its file."""
    return length(placement[:3, 0]) * compose(camera, invert_similarity(placement))

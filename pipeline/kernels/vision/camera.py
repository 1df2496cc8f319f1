"""A pinhole camera: where it stands, what it sees of the world, and where a world point falls in its image.

Image coordinates are (column, row) in pixels from the image's top left corner, so that the centre of pixel (row, col) lies at
(col + 1/2, row + 1/2).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]


class Camera(BaseModel):
    """A square pinhole camera that looks along its own -z with +y up (OpenGL's and Blender's convention).

    Attributes
    ----------
    position
        Optical centre in the world, m.
    rotation
        Extrinsic XYZ Euler angles in degrees: about the world's x first, then its y, then its z.
    focal, centre
        Focal lengths (x, y) and principal point (column, row), pixels.
    resolution
        Pixels a side.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    position: Vector
    rotation: Vector
    focal: tuple[Positive, Positive]
    centre: tuple[float, float]
    resolution: int = Field(gt=0)

    def at(self, resolution: int) -> Camera:
        """The same view in another number of pixels a side, 1 or more: the intrinsics scale with it."""
        if resolution < 1:
            raise ValueError(f"an image of {resolution} pixels a side shows nothing; ask for 1 or more")
        scale = resolution / self.resolution
        return self.model_copy(
            update={
                "focal": (self.focal[0] * scale, self.focal[1] * scale),
                "centre": (self.centre[0] * scale, self.centre[1] * scale),
                "resolution": resolution,
            }
        )


def euler_xyz(degrees: Vector) -> NDArray[np.float64]:
    """(3, 3) rotation by extrinsic XYZ Euler angles: R = Rz Ry Rx."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, np.float64)


def pose(camera: Camera) -> NDArray[np.float64]:
    """(4, 4) the camera's frame in the world: columns right, up, backwards, position."""
    placed = np.eye(4)
    placed[:3, :3] = euler_xyz(camera.rotation)
    placed[:3, 3] = camera.position
    return placed


def projection_matrix(camera: Camera) -> NDArray[np.float64]:
    """(3, 4) float64 projection of world points, m, to pixels: (u w, v w, w) = M (x, y, z, 1), u along columns, v along rows.

    w is the distance along the viewing direction, m; points with w <= 0 lie behind the camera.
    """
    intrinsic = np.array([[camera.focal[0], 0, camera.centre[0]], [0, camera.focal[1], camera.centre[1]], [0, 0, 1.0]])
    to_camera = np.linalg.inv(pose(camera))[:3]  # (3, 4), y up and z backwards
    return np.asarray(intrinsic @ np.diag([1.0, -1.0, -1.0]) @ to_camera)


def project(matrix: NDArray[np.float64], points: NDArray[np.floating]) -> NDArray[np.float64]:
    """(..., 2) pixel coordinates (column, row) of finite world points (..., 3), m; NaN for points at or behind the camera.

    Right to 1.5e-14 times the focal length in pixels, times how often a point's distance from the camera goes into the largest
    coordinate: 6e-9 pixels a kilometre from the origin.
    """
    if not np.isfinite(points).all():
        raise ValueError("NaN or infinite points have no place in an image; drop them first")
    homogeneous = np.asarray(points, np.float64) @ matrix[:, :3].T + matrix[:, 3]  # (..., 3)
    depth = homogeneous[..., 2:]
    return np.where(depth > 0, homogeneous[..., :2] / np.where(depth > 0, depth, 1), np.nan)


def look_at(camera: Camera, position: Vector, target: Vector) -> Camera:
    """`camera` moved to `position`, m, its optical axis through `target`, without roll (the world's z is up).

    Raises
    ------
    ValueError
        Where the target is straight above or below the position, or the same: then "without roll" says nothing. Or where
        one of them is NaN or infinite.
    """
    if not np.isfinite([position, target]).all():
        raise ValueError(f"no camera at {position} can look at {target}: both must be finite")
    backward = np.subtract(position, target)
    across = float(np.hypot(backward[0], backward[1]))
    if across == 0:
        raise ValueError(f"a camera at {position} that looks at {target} has no horizontal direction: move it sideways")
    tilt = np.rad2deg(np.arctan2(across, backward[2]))  # 0 looks straight down, 90 at the horizon
    turn = np.rad2deg(np.arctan2(backward[0], -backward[1]))
    return camera.model_copy(update={"position": position, "rotation": (float(tilt), 0.0, float(turn))})

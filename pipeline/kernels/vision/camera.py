"""A pinhole camera: its pose, its projection matrix, the projection of world points; and the cameras of 3D-R2N2's renderings.

Image coordinates are (column, row) in pixels from the image's top left corner: the centre of pixel (row, col) is (col + 1/2, row + 1/2).

Valid range: cameras and points within 100 m of the origin, at least 1 mm apart. Image coordinates are then right to 1e-9 pixels.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pipeline.entries import Entries, Range
from pipeline.kernels.arrays import Array, Floats
from pipeline.kernels.geometry.transforms import compose, invert_pose, invert_similarity, length, pose_of, rotation_from_euler

Coordinate = Annotated[float, Field(ge=-100, le=100)]
Distance = Annotated[float, Field(gt=0, le=100)]
Elevation = Annotated[float, Field(ge=-85, le=85)]
Angle = Annotated[float, Field(ge=-3600, le=3600)]
Pixels = Annotated[float, Field(ge=-1e6, le=1e6)]
Focal = Annotated[float, Field(ge=1e-3, le=1e6)]
Vector = tuple[float, float, float]

MAX_RESOLUTION = 8192  # pixels per side of an image: graphics libraries draw no larger ones
Side = Annotated[int, Field(ge=16, le=MAX_RESOLUTION)]
FOCAL, SENSOR = 35.0, 32.0  # mm, of the renderings' camera: focal length, width; not the metadata's field of view
FARTHEST = 1.75  # distance of the renderings' camera from the origin where the ratio is 1, units of the file


class DrawnViews(Entries):
    """Where a camera is in each image, drawn evenly; it looks at the object's middle, its top upwards."""

    distance: Range[Distance] = Field(description="from the middle of the object, m: least and most")
    elevation: Range[Elevation] = Field(description="above the horizon, degrees: least and most")
    azimuth: Range[Angle] = Field((-180.0, 180.0), description="about the world's +z, from +x, degrees: least and most")

    def draw(self, rng: np.random.Generator, middle: Array) -> Array:  # (3,) world, m
        """Draw the position of a camera around a point."""
        distance, elevation, azimuth = (rng.uniform(*limits) for limits in (self.distance, self.elevation, self.azimuth))
        e, a = np.deg2rad([elevation, azimuth])
        return np.asarray(middle + distance * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]))

    def nearest(self, azimuth: float, elevation: float) -> tuple[float, float]:
        """Find the drawn direction nearest to another one, degrees."""
        first, last = self.azimuth
        turned = first + (azimuth - first) % 360
        if turned > last:
            turned = last if turned - last < first + 360 - turned else first
        return turned, min(max(elevation, self.elevation[0]), self.elevation[1])


class Camera(Entries):
    """A pinhole camera that looks along its own -z with +y up (OpenGL's and Blender's convention)."""

    position: tuple[Coordinate, Coordinate, Coordinate] = Field(description="optical centre, world frame, m")
    rotation: tuple[Angle, Angle, Angle] = Field(description="extrinsic XYZ Euler angles, degrees: about the world's x, then y, then z")
    focal: tuple[Focal, Focal] = Field(description="focal lengths (x, y), pixels")
    centre: tuple[Pixels, Pixels] = Field(description="principal point (column, row) from the image's top left corner, pixels")
    resolution: int = Field(256, gt=0, le=MAX_RESOLUTION, description="of a square image, pixels per side that `focal` and `centre` are in")
    name: str = Field(pattern=r"^[A-Za-z0-9._-]{1,60}$", description="labels its images")
    size: tuple[Side, Side] | None = Field(
        default=None, description="columns and rows of its images, regardless of `render-vision.resolution`; by default square"
    )

    drawn: DrawnViews | None = Field(default=None, description="from where images are taken instead; checks draw from `position`")

    @model_validator(mode="after")
    def _has_one_size(self) -> "Camera":
        if self.size is not None and self.resolution != type(self).model_fields["resolution"].default:  # which a stored scene has
            raise ValueError(f"resolution {self.resolution} and size {list(self.size)} are two sizes of one image; leave resolution out")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of its images."""
        return (self.resolution, self.resolution) if self.size is None else (self.size[1], self.size[0])

    def with_resolution(self, resolution: int) -> "Camera":
        """Return the camera with another number of pixels per side and the same field of view; one with a `size` as it is."""
        if self.size is not None:
            return self
        if resolution < 1:
            raise ValueError(f"an image of {resolution} pixels per side shows nothing; ask for 1 or more")
        scale = resolution / self.resolution
        focal, centre = (tuple(scale * length for length in pair) for pair in (self.focal, self.centre))
        return self.model_copy(update={"focal": focal, "centre": centre, "resolution": resolution})

    def zoomed(self, factor: float, at: Array | None = None) -> "Camera":
        """Return the camera with its focal lengths multiplied; what it sees at pixel `at` (2,), by default the centre, stays there."""
        moved = np.zeros(2) if at is None or not np.isfinite(at).all() else (factor - 1) * (np.array(self.centre) - at)
        focal, centre = (factor * self.focal[0], factor * self.focal[1]), tuple((np.array(self.centre) + moved).tolist())
        return self.model_copy(update={"focal": focal, "centre": centre})


def camera_pose(camera: Camera) -> Array:  # (4, 4)
    """Compute the camera's frame in the world, m: columns right, up, backwards, position."""
    return pose_of(rotation_from_euler(np.deg2rad(camera.rotation)), camera.position)


def projection_matrix(camera: Camera) -> Array:
    """Compute the matrix M (3, 4) that projects world points, m, to pixels.

    (u w, v w, w) = M (x, y, z, 1), u along columns, v along rows; w is the distance along the viewing direction, m, > 0 ahead.
    """
    intrinsic = np.array([[camera.focal[0], 0, camera.centre[0]], [0, camera.focal[1], camera.centre[1]], [0, 0, 1.0]])
    to_camera = invert_pose(camera_pose(camera))[:3]  # (3, 4), y up and z backwards
    return compose(intrinsic * [1.0, -1.0, -1.0], to_camera)


def project_points(matrix: Array, points: Floats) -> Array:  # (..., 2) (column, row), pixels
    """Project world points (..., 3), m, by a projection matrix (3, 4); NaN for points at or behind the camera."""
    if not np.isfinite(points).all():
        raise ValueError("points hold NaN or infinity; drop them before projecting")
    homogeneous = np.asarray(points, np.float64) @ matrix[:, :3].T + matrix[:, 3]  # (..., 3)
    depth = homogeneous[..., 2:]
    return np.where(depth > 0, homogeneous[..., :2] / np.where(depth > 0, depth, 1), np.nan)


def look_at(camera: Camera, position: Vector, target: Vector) -> Camera:
    """Move a camera to a position and point it at a target, both world, m, without roll (the world's z is up)."""
    if not np.isfinite([position, target]).all():
        raise ValueError(f"camera position {position} and target {target} must be finite")
    backward = np.subtract(position, target)
    across = float(np.hypot(backward[0], backward[1]))
    if across == 0:
        raise ValueError(f"a camera at {position} that looks at {target} has no horizontal direction: move it sideways")
    tilt = np.rad2deg(np.arctan2(across, backward[2]))  # 0 looks straight down, 90 at the horizon
    turn = np.rad2deg(np.arctan2(backward[0], -backward[1]))
    return camera.model_copy(update={"position": position, "rotation": (float(tilt), 0.0, float(turn))})


@dataclass(frozen=True)
class Viewpoint:
    """Where Blender made a rendering of 3D-R2N2 from, of a ShapeNetCore file, y up: a line of `rendering_metadata.txt`."""

    azimuth: float  # degrees; 0 is +x, 90 is +z
    elevation: float  # degrees; 90 is straight above
    in_plane: float  # degrees, rotation about the viewing direction: 0 in all renderings
    distance: float  # over `FARTHEST`


def viewpoint_camera(viewpoint: Viewpoint, resolution: int) -> Array:
    """Compute the projection matrix (3, 4) of a rendering, whose camera looks at the origin, without roll.

    It takes homogeneous points of the mesh file (y up, its units) to (column, row, 1) times depth, in units of the file.
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


def placed_camera(camera: Array, placement: Array) -> Array:  # camera: (3, 4), points of the file to pixels
    """Compute the projection matrix (3, 4) that shows an object, m, placed by a similarity (4, 4), as a camera shows its file."""
    return length(placement[:3, 0]) * compose(camera, invert_similarity(placement))

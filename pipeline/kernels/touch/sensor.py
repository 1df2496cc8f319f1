"""The description of a tactile sensor, the positions of its pixels, and its pose.

The sensor frame has its origin at the centre of the sensor plane, the base of the gel; +x runs along image columns, +y along image
rows, +z is the outward normal. Lengths are metres.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from pipeline.errors import InvalidInput

MAX_PIXELS_PER_SIDE = 4096
"""Rows and columns of an image: more than any camera of a sensor has."""

Length = Annotated[float, Field(ge=1e-6, le=10)]
Lateral = Annotated[float, Field(ge=-1000, le=1000)]
Position = tuple[Lateral, Lateral, Annotated[float, Field(gt=0, le=1000)]]

POSE_TOLERANCE = 1e-6
"""Largest deviation of a pose's axes from orthonormal: what float32 arithmetic may leave."""


class Lights(BaseModel):
    """Positions P of the three lamps of equation 5, in sensor widths from the corner of pixel (0, 0)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    red: Position
    green: Position
    blue: Position


class Sensor(BaseModel):
    """A gel on a square sensor plane, seen by a camera below it."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]+$", max_length=120)]
    width: Annotated[Length, Field(description="side of the square sensor plane, m")]
    rows: Annotated[int, Field(ge=2, le=MAX_PIXELS_PER_SIDE, description="pixels along +y; a gradient needs two")]
    cols: Annotated[int, Field(ge=2, le=MAX_PIXELS_PER_SIDE, description="pixels along +x; a gradient needs two")]
    w: Annotated[Length, Field(description="thickness of the gel, m (equation 1)")]
    range: Annotated[Length, Field(description="greatest depth at which a surface is found, m")]
    diffuse: Annotated[float, Field(gt=0, le=1e6, description="diffuse reflection constant, lambda of equation 2")]
    noise: Annotated[Literal["none"], Field(description="noise added to a tactile image")]
    lights: Lights

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of an image."""
        return self.rows, self.cols


def pixel_centres(sensor: Sensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute the positions of the pixel centres on the sensor plane.

    Parameters
    ----------
    sensor
        Gives width, rows and columns.

    Returns
    -------
    x, y
        (cols,) and (rows,) float64, sensor frame, m.

    Notes
    -----
    x = ((col + ½)/cols - ½) · width, y = ((row + ½)/rows - ½) · width.
    """
    x = ((np.arange(sensor.cols) + 0.5) / sensor.cols - 0.5) * sensor.width
    y = ((np.arange(sensor.rows) + 0.5) / sensor.rows - 0.5) * sensor.width
    return x, y


def masked_points(depth: np.ndarray, mask: NDArray[np.bool_], sensor: Sensor) -> NDArray[np.float64]:
    """Compute the points that some pixels of a depth map see.

    Parameters
    ----------
    depth
        (rows, cols) D, m.
    mask
        (rows, cols), true at n pixels.
    sensor
        Gives the pixels' positions.

    Returns
    -------
    (n, 3) float64, sensor frame, m, in row-major order of the pixels.
    """
    row, col = np.nonzero(mask)
    x, y = pixel_centres(sensor)
    return np.stack([x[col], y[row], depth[row, col]], axis=1, dtype=np.float64)


def check_pose(pose: np.ndarray) -> NDArray[np.float64]:
    """Check that a sensor pose is a rigid motion.

    Parameters
    ----------
    pose
        (4, 4), sensor frame to world frame, m.

    Returns
    -------
    The pose as (4, 4) float64.

    Raises
    ------
    ValueError
        The shape is not (4, 4).
    InvalidInput
        An entry is NaN or infinite, the axes are not orthonormal and right-handed, or the last row is not 0 0 0 1.
    """
    pose = np.asarray(pose, np.float64)
    if pose.shape != (4, 4):
        raise ValueError(f"sensor pose has shape {pose.shape}; it must be (4, 4), sensor frame to world frame")
    if not np.isfinite(pose).all():
        raise InvalidInput(f"sensor pose holds NaN or infinity; it must be finite:\n{pose}")
    rotation = pose[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if not deviation <= POSE_TOLERANCE or np.linalg.det(rotation) < 0:  # NaN, where squares overflow, is neither
        raise InvalidInput(
            f"sensor pose is no rigid motion: its axes are {deviation:.3g} from orthonormal "
            f"(at most {POSE_TOLERANCE:g}, determinant +1); scale belongs into the mesh, not the pose:\n{pose}"
        )
    if (pose[3] != (0, 0, 0, 1)).any():
        raise InvalidInput(f"sensor pose has the last row {pose[3]}; it must be 0 0 0 1 (is the pose transposed?):\n{pose}")
    return pose


def sensor_to_world(pose: NDArray[np.float64], x: np.ndarray, y: np.ndarray, z: np.ndarray) -> NDArray[np.float64]:
    """Transform points from the sensor frame to the world frame.

    Parameters
    ----------
    pose
        (4, 4) float64, sensor frame to world frame.
    x, y, z
        Coordinates that broadcast to one shape (...), sensor frame, m.

    Returns
    -------
    (..., 3) float64, world frame, m.

    Notes
    -----
    Element by element, not by a matrix product: a point has the same bits in an array of any size.
    """
    return np.stack([row[3] + (row[0] * x + row[1] * y + row[2] * z) for row in pose[:3]], axis=-1)


def ray_origins(pose: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """Compute the pixel centres on the sensor plane, where rays start; they leave along `pose[:3, 2]`.

    Parameters
    ----------
    pose
        (4, 4), sensor frame to world frame, m.
    sensor
        Gives the grid of pixels.

    Returns
    -------
    (rows, cols, 3) float64, world frame, m.

    Raises
    ------
    ValueError, InvalidInput
        As `check_pose`.
    """
    x, y = pixel_centres(sensor)
    return sensor_to_world(check_pose(pose), x[None, :], y[:, None], np.zeros(sensor.shape))

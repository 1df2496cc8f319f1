"""The description of a tactile sensor, and where its pixels and rays are."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Length = Annotated[float, Field(gt=0)]
Position = tuple[float, float, Annotated[float, Field(gt=0)]]

POSE_TOLERANCE = 1e-6
"""How far a pose's axes may be from orthonormal: what float32 arithmetic upstream may leave, no more."""


class Lights(BaseModel):
    """Positions P of the three lamps of equation 5, in sensor widths from the corner of pixel (0, 0)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    red: Position
    green: Position
    blue: Position


class Sensor(BaseModel):
    """A gel on a square sensor plane, looked at from below.

    The sensor frame has its origin at the centre of the sensor plane, the base of the gel; +x runs along image columns,
    +y along image rows, +z is the outward normal. Lengths are metres.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]+$")]
    width: Annotated[Length, Field(description="side of the square sensor plane, m")]
    rows: Annotated[int, Field(ge=2, description="pixels along +y; a gradient needs two")]
    cols: Annotated[int, Field(ge=2, description="pixels along +x; a gradient needs two")]
    w: Annotated[Length, Field(description="thickness of the gel, m (equation 1)")]
    range: Annotated[Length, Field(description="how far a ray looks for a surface, m")]
    diffuse: Annotated[float, Field(gt=0, description="diffuse reflection constant, lambda of equation 2")]
    noise: Annotated[Literal["none"], Field(description="noise added to a reading")]
    lights: Lights

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of an image."""
        return self.rows, self.cols


@lru_cache(maxsize=8)
def pixel_centres(sensor: Sensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """X (cols,) and y (rows,) of the pixel centres in the sensor frame, m; read-only."""
    x = ((np.arange(sensor.cols) + 0.5) / sensor.cols - 0.5) * sensor.width
    y = ((np.arange(sensor.rows) + 0.5) / sensor.rows - 0.5) * sensor.width
    x.setflags(write=False)
    y.setflags(write=False)
    return x, y


def check_pose(pose: np.ndarray) -> NDArray[np.float64]:
    """A sensor pose as (4, 4) float64, sensor frame to world frame; a `ValueError` where it is no rigid motion."""
    pose = np.asarray(pose, np.float64)
    if pose.shape != (4, 4):
        raise ValueError(f"sensor pose has shape {pose.shape}; it must be (4, 4), sensor frame to world frame")
    if not np.isfinite(pose).all():
        raise ValueError(f"sensor pose holds NaN or infinity; it must be finite:\n{pose}")
    rotation = pose[:3, :3]
    deviation = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if deviation > POSE_TOLERANCE or np.linalg.det(rotation) < 0:
        raise ValueError(
            f"sensor pose is no rigid motion: its axes are {deviation:.3g} from orthonormal "
            f"(at most {POSE_TOLERANCE:g}, determinant +1); scale belongs into the mesh, not the pose:\n{pose}"
        )
    if (pose[3] != (0, 0, 0, 1)).any():
        raise ValueError(f"sensor pose has the last row {pose[3]}; it must be 0 0 0 1 (is the pose transposed?):\n{pose}")
    return pose


def sensor_to_world(pose: NDArray[np.float64], x: np.ndarray, y: np.ndarray, z: np.ndarray) -> NDArray[np.float64]:
    """World points (..., 3) of sensor-frame coordinates that broadcast to one shape, m.

    Element by element, never by a matrix product: a point is the same to the last bit in whatever batch it comes.
    """
    return np.stack([row[3] + (row[0] * x + row[1] * y + row[2] * z) for row in pose[:3]], axis=-1)


def ray_origins(pose: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """(rows, cols, 3) world positions of the pixel centres on the sensor plane, m; rays leave along `pose[:3, 2]`."""
    x, y = pixel_centres(sensor)
    return sensor_to_world(check_pose(pose), x[None, :], y[:, None], np.zeros(sensor.shape))

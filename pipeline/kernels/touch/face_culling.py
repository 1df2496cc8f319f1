"""Which faces a sensor can see: blocks of neighbouring faces, culled against the prism that the sensor's rays sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.sensor import Sensor, check_pose

BLOCK = 32
"""Faces a block: so few that a block at the prism's rim brings little along, so many that testing blocks is cheap."""
SLACK = 1e-9
"""m, by which boxes and prism are grown against rounding: far above it for objects within kilometres of the origin."""
MORTON_BITS = 10
"""Bits an axis of the code that orders faces: a thousand cells, finer than a block for any mesh whose blocks matter."""


@dataclass(frozen=True)
class FaceBlocks:
    """A mesh made ready for sensors: its faces in blocks of neighbours, each with its box.

    Attributes
    ----------
    corners
        (3 axes, 3 corners, B, BLOCK) float64, m, world frame. The last block is filled up with copies of one face.
    centre, half
        (3, B) float64, m: centre and half extent of every block's axis-aligned box.
    """

    corners: NDArray[np.float64]
    centre: NDArray[np.float64]
    half: NDArray[np.float64]


def face_blocks(triangles: np.ndarray) -> FaceBlocks:
    """Sort faces along a Morton curve and cut the curve into blocks, once an object.

    Parameters
    ----------
    triangles
        (F, 3, 3) float64 corner positions, m, world frame; F may be 0. Winding, duplicates and holes do not matter.
    """
    triangles = np.asarray(triangles, np.float64)
    if triangles.ndim != 3 or triangles.shape[1:] != (3, 3):
        raise ValueError(f"triangles have shape {triangles.shape}; they must be (F, 3, 3): face, corner, xyz")
    if not np.isfinite(triangles).all():
        raise ValueError("triangles hold NaN or infinity; drop such faces before tracing")
    if len(triangles) == 0:
        return FaceBlocks(np.zeros((3, 3, 0, BLOCK)), np.zeros((3, 0)), np.zeros((3, 0)))
    order = np.argsort(_morton(triangles.mean(axis=1)), kind="stable")
    filled = -(-len(order) // BLOCK) * BLOCK
    order = np.concatenate([order, np.repeat(order[-1], filled - len(order))])
    corners = np.ascontiguousarray(triangles[order].transpose(2, 1, 0)).reshape(3, 3, -1, BLOCK)
    low, high = corners.min(axis=(1, 3)), corners.max(axis=(1, 3))  # (3, B)
    return FaceBlocks(corners, (low + high) / 2, (high - low) / 2)


def cull_faces(blocks: FaceBlocks, pose: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """Faces in the sensor's frame: all that a ray of the sensor can meet, and few others.

    The same corner gets the same coordinates to the last bit in whatever face it occurs, so shared edges stay shared.

    Returns
    -------
    (3 axes, 3 corners, N) float64, m, sensor frame. N is 0 for a sensor that sees nothing.
    """
    pose = check_pose(pose)
    rotation, origin = pose[:3, :3], pose[:3, 3]
    prism_half = np.array([sensor.width, sensor.width, sensor.range])[:, None] / 2
    prism_centre = np.array([0.0, 0.0, sensor.range / 2])[:, None]
    centre = rotation.T @ (blocks.centre - origin[:, None])  # (3, B)
    reach = np.abs(rotation.T) @ blocks.half + prism_half + SLACK
    near = np.flatnonzero((np.abs(centre - prism_centre) <= reach).all(axis=0))
    offset = blocks.corners[:, :, near].reshape(3, 3, -1) - origin[:, None, None]
    local = np.stack([r[0] * offset[0] + r[1] * offset[1] + r[2] * offset[2] for r in rotation.T])
    low, high = local.min(axis=1), local.max(axis=1)  # (3, n)
    inside = ((low <= prism_centre + prism_half + SLACK) & (high >= prism_centre - prism_half - SLACK)).all(axis=0)
    return local[:, :, inside]


def _morton(points: NDArray[np.float64]) -> NDArray[np.uint64]:
    """(N,) interleaved bits of the cell of every point, so that points near on the curve are near in space."""
    low = points.min(axis=0)
    extent = max(float((points.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    cell = np.minimum((points - low) / extent * 2**MORTON_BITS, 2**MORTON_BITS - 1).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return code

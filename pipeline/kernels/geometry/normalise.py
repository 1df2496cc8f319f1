"""Placing an object in the scene: upright, of one size, at one position (supplement 1.4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import length

POSITION = np.array([0.0, 0.0, 0.6])
"""Where the centre of an object's bounding box stands in the world, m."""

_TO_Z_UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),  # a quarter turn about x: y becomes z
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),  # a quarter turn about y: x becomes z
}


def normalise_mesh(mesh: Mesh, up: str, diagonal: float, metres_per_unit: float | None = None) -> Mesh:
    """The mesh upright at `POSITION`, its bounding box having the given diagonal, m.

    `up` names the axis of the source that points up. With `metres_per_unit` the object keeps its real size instead.
    The bounding box is centred before it is scaled, so an object far from the origin keeps the digits that its file has.

    Raises
    ------
    ValueError
        There are no vertices, some are not finite, or all are at one place.
    """
    if not (len(mesh.vertices) and np.isfinite(mesh.vertices).all()):
        raise ValueError(f"of {len(mesh.vertices)} vertices some are NaN or infinite, or there are none; gate the mesh first")
    upright = mesh.vertices @ _TO_Z_UP[up].T
    low, high = upright.min(axis=0), upright.max(axis=0)
    size = float(length(high - low))
    if size == 0:
        raise ValueError(f"all {len(upright)} vertices are at {low}: nothing can be scaled to a size; gate the mesh first")
    scale = metres_per_unit if metres_per_unit is not None else diagonal / size
    vertices: NDArray[np.float64] = (upright - (low + (high - low) / 2)) * scale + POSITION
    return replace(mesh, vertices=vertices)

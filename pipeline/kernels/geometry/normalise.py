"""Normalisation of a mesh: upright, of one size, at one position (supplement 1.4)."""

from dataclasses import replace

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats
from pipeline.kernels.geometry.mesh import Mesh, check_coordinates
from pipeline.kernels.geometry.transforms import length

POSITION, DIAGONAL = np.array([0.0, 0.0, 0.6]), 0.5  # of bounding boxes, m: centre; diagonal of objects without a real size
_TO_Z_UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),  # a quarter turn about x: y becomes z
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),  # a quarter turn about y: x becomes z
}


DIGITS = 4  # of a diagonal: more than any result depends on, few enough that objects scaled to one size have exactly this size


def bounding_diagonal(vertices: Floats) -> float:
    """Compute the diagonal of the bounding box of vertices (V, 3), rounded to `DIGITS` digits, in their unit."""
    return float(f"{length(np.ptp(vertices, axis=0)):.{DIGITS}g}")


def normalise_mesh(
    mesh: Mesh,  # cleaned, in the units of its file
    *,
    up: str,  # the axis of the file that points up: "x", "y" or "z"
    diagonal: float,  # of the bounding box afterwards, m
    metres_per_unit: float | None = None,  # scale that keeps the object's real size; replaces `diagonal`
) -> Mesh:  # world, m
    """Turn a mesh upright, scale it and centre its bounding box at `POSITION`: before it is scaled, to keep the digits of its file."""
    upright, centre, scale = _upright(mesh, up, diagonal, metres_per_unit)
    vertices: Array = (upright - centre) * scale + POSITION
    return replace(mesh, vertices=vertices)


def normalising_transform(mesh: Mesh, *, up: str, diagonal: float, metres_per_unit: float | None = None) -> Array:
    """Compute the transform (4, 4) that `normalise_mesh` with the same arguments applies: a rotation, one scale, a shift."""
    _, centre, scale = _upright(mesh, up, diagonal, metres_per_unit)
    placement = np.eye(4)
    placement[:3, :3] = scale * _TO_Z_UP[up]
    placement[:3, 3] = POSITION - scale * centre
    return placement


def _upright(mesh: Mesh, up: str, diagonal: float, metres_per_unit: float | None) -> tuple[Array, Array, float]:
    """Turn the vertices upright; return them, the centre of their bounding box, and the scale."""
    if not len(mesh.vertices):
        raise InvalidInput("the mesh has no vertices, so it cannot be scaled to a size")
    check_coordinates(mesh.vertices, "vertices")
    upright = mesh.vertices @ _TO_Z_UP[up].T
    low, high = upright.min(axis=0), upright.max(axis=0)
    size = float(length(high - low))
    if size == 0:
        raise InvalidInput(f"all {len(upright)} vertices are at {low}, so the mesh cannot be scaled to a size")
    scale = metres_per_unit if metres_per_unit is not None else diagonal / size
    return upright, low + (high - low) / 2, scale

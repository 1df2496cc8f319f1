"""Checks, cleaning and normalisation of a mesh as it was read from a file: upright, of one size, at one position (supplement 1.4).

Valid range: meshes from 1e-9 to 1e9 units large, anywhere within 1e6 of their size from the origin.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats, Indices, Integers
from pipeline.kernels.geometry.mesh import Look, Mesh, check_coordinates, flatness, is_watertight
from pipeline.kernels.geometry.transforms import length, pose_of

MIN_FLATNESS = 1e-14  # height over longest edge at which a face is degenerate: zero, but for rounding
POSITION, DIAGONAL = np.array([0.0, 0.0, 0.6]), 0.5  # of bounding boxes, m: centre; diagonal of objects without a real size
_TO_Z_UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),  # a quarter turn about x: y becomes z
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),  # a quarter turn about y: x becomes z
}
DIGITS = 4  # of a diagonal: more than any result depends on, few enough that objects scaled to one size have exactly this size


@dataclass(frozen=True)
class CleaningReport:
    """What `clean_mesh` removed."""

    degenerate_faces: int
    duplicate_faces: int
    watertight: bool  # whether every remaining edge has two faces


def clean_mesh(mesh: Mesh, max_faces: int) -> tuple[Mesh, CleaningReport]:
    """Remove degenerate and duplicate faces and unused vertices, and refuse a mesh that has no usable surface."""
    faces = len(mesh.faces)
    if faces == 0:
        raise InvalidInput(f"the mesh has {len(mesh.vertices)} vertices and no faces; export it as a triangle mesh")
    if faces > max_faces:
        raise InvalidInput(f"{faces} faces exceed max_faces = {max_faces}; decimate the mesh or raise sample-surfaces.max_faces")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise InvalidInput(f"a face names a vertex outside 0..{len(mesh.vertices) - 1}; the file is damaged")
    check_coordinates(mesh.vertices[np.unique(mesh.faces)], "vertices")

    degenerate = flatness(mesh.triangles) <= MIN_FLATNESS
    mesh = _keep_faces(mesh, ~degenerate)
    if len(mesh.faces) == 0:
        raise InvalidInput(f"all {faces} faces have zero area; the mesh has no surface")
    positions = number_positions(mesh.vertices)[mesh.faces]
    unique_faces = np.sort(np.unique(np.sort(positions, axis=1), axis=0, return_index=True)[1])  # first of those between the same positions
    watertight = is_watertight(positions[unique_faces])
    return _keep_faces(mesh, unique_faces), CleaningReport(int(degenerate.sum()), len(positions) - len(unique_faces), watertight)


def number_positions(vertices: Array) -> Indices:
    """Count through the distinct positions of vertices (V, 3): (V,), equal where positions are equal to the bit, -0 and 0 the same."""
    return np.unique(vertices + 0.0, axis=0, return_inverse=True)[1].reshape(-1)  # + 0.0 makes -0 and 0 the same


def group_by_position(position: Integers) -> list[Indices]:
    """List the vertices of each position number (V,), in ascending order."""
    order = np.argsort(position, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(position[order])) + 1)


def _keep_faces(mesh: Mesh, keep: NDArray[Any]) -> Mesh:
    """Keep these faces and the vertices they use, in the order of their use: readers of files number them by an unstable sort."""
    from trimesh.grouping import unique_ordered  # takes half a second

    used, faces = unique_ordered(mesh.faces[keep].ravel(), return_inverse=True)
    colors = None if mesh.look.vertex_color is None else mesh.look.vertex_color[used]
    look: Look = replace(mesh.look, uv=mesh.look.uv[used], face_material=mesh.look.face_material[keep], vertex_color=colors)
    return replace(mesh, vertices=mesh.vertices[used], faces=faces.reshape(-1, 3).astype(np.int32), look=look)


def bounding_diagonal(vertices: Floats) -> float:
    """Compute the diagonal of the bounding box of vertices (V, 3), rounded to `DIGITS` digits, in their unit."""
    return float(f"{length(np.ptp(vertices, axis=0)):.{DIGITS}g}")


def normalise_mesh(
    mesh: Mesh,  # cleaned, in the units of its file
    *,
    up: str,  # the axis of the file that points up: "x", "y" or "z"
    diagonal: float,  # of the bounding box afterwards, m
    metres_per_unit: float | None = None,  # scale that keeps the object's real size; replaces `diagonal`
) -> tuple[Mesh, Array]:  # world, m; the transform (4, 4) from the file to the world: a rotation, one scale, a shift
    """Turn a mesh upright, scale it and centre its bounding box at `POSITION`: before it is scaled, to keep the digits of its file."""
    if not len(mesh.vertices):
        raise InvalidInput("the mesh has no vertices, so it cannot be scaled to a size")
    check_coordinates(mesh.vertices, "vertices")
    upright = mesh.vertices @ _TO_Z_UP[up].T
    low, high = upright.min(axis=0), upright.max(axis=0)
    size = float(length(high - low))
    if size == 0:
        raise InvalidInput(f"all {len(upright)} vertices are at {low}, so the mesh cannot be scaled to a size")
    scale, centre = metres_per_unit if metres_per_unit is not None else diagonal / size, low + (high - low) / 2
    placement = pose_of(scale * _TO_Z_UP[up], POSITION - scale * centre)
    return replace(mesh, vertices=np.asarray((upright - centre) * scale + POSITION)), placement

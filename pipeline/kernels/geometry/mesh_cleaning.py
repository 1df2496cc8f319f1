"""Checks and cleaning of a mesh as it was read from a file.

Valid range: meshes from 1e-9 to 1e9 units large, anywhere within 1e6 of their size from the origin.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Indices
from pipeline.kernels.geometry.mesh import Look, Mesh, check_coordinates, flatness, is_watertight

MIN_FLATNESS = 1e-14  # height over longest edge at which a face is degenerate: zero, but for rounding


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


def _keep_faces(mesh: Mesh, keep: NDArray[Any]) -> Mesh:
    """Keep these faces and the vertices they use, in the order of their use: readers of files number them by an unstable sort."""
    from trimesh.grouping import unique_ordered  # takes half a second

    used, faces = unique_ordered(mesh.faces[keep].ravel(), return_inverse=True)
    colors = None if mesh.look.vertex_color is None else mesh.look.vertex_color[used]
    look: Look = replace(mesh.look, uv=mesh.look.uv[used], face_material=mesh.look.face_material[keep], vertex_color=colors)
    return replace(mesh, vertices=mesh.vertices[used], faces=faces.reshape(-1, 3).astype(np.int32), look=look)

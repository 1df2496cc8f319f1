"""The gate every mesh passes: what is no surface is refused with a reason, what is harmless is removed and counted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Look, Mesh, flatness

FLAT = 1e-14
"""A face is degenerate when it is flatter than this, its height over its longest edge: zero, but for rounding."""


@dataclass(frozen=True)
class CleaningReport:
    """What the gate found: faces removed, and whether every edge that is left has two faces."""

    degenerate_faces: int
    duplicate_faces: int
    watertight: bool


def clean_mesh(mesh: Mesh, max_faces: int) -> tuple[Mesh, CleaningReport]:
    """A mesh fit for every later stage, and what had to be removed from it.

    Raises
    ------
    ValueError
        No faces, too many, faces that name missing vertices, vertices that are not finite, or no area: with the
        numbers, and what a person can do.
    """
    faces = len(mesh.faces)
    if faces == 0:
        raise ValueError(f"the mesh has {len(mesh.vertices)} vertices and no faces; export it as a triangle mesh")
    if faces > max_faces:
        raise ValueError(f"{faces} faces exceed max_faces = {max_faces}; decimate the mesh or raise sample-surfaces.max_faces")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ValueError(f"a face names a vertex outside 0..{len(mesh.vertices) - 1}; the file is damaged")
    used = mesh.vertices[np.unique(mesh.faces)]
    if bad := int((~np.isfinite(used)).any(axis=1).sum()):
        raise ValueError(f"{bad} of {len(used)} vertices are not finite (NaN or infinite); repair the file")
    scale = float(np.ptp(used, axis=0).max())
    if not 1e-150 < scale < 1e150:
        raise ValueError(f"the mesh is {scale:g} units across; areas need 1e-150 to 1e150: rescale it")

    flat = flatness(mesh.triangles) <= FLAT
    mesh = _keep_faces(mesh, ~flat)
    if len(mesh.faces) == 0:
        raise ValueError(f"all {faces} faces have zero area; the mesh has no surface")
    places = number_positions(mesh.vertices)[mesh.faces]
    _, first = np.unique(np.sort(places, axis=1), axis=0, return_index=True)
    once = np.zeros(len(mesh.faces), bool)
    once[first] = True
    report = CleaningReport(int(flat.sum()), int((~once).sum()), _closed(places[once]))
    return _keep_faces(mesh, once), report


def number_positions(vertices: NDArray[np.float64]) -> NDArray[np.intp]:
    """(V,) a number for every vertex, equal where positions are equal to the bit."""
    return np.unique(vertices + 0.0, axis=0, return_inverse=True)[1].reshape(-1)  # + 0.0 makes -0 and 0 the same


def _closed(places: NDArray[np.intp]) -> bool:
    edges = np.sort(places[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    return bool((count == 2).all())


def _keep_faces(mesh: Mesh, keep: NDArray[np.bool_]) -> Mesh:
    """The mesh with these faces and the vertices they use, in the order of their use: readers of files number them by an unstable sort."""
    vertices, first, entry = np.unique(mesh.faces[keep], return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    used, faces = vertices[order], np.argsort(order, kind="stable")[entry]
    look: Look = replace(mesh.look, uv=mesh.look.uv[used], face_material=mesh.look.face_material[keep])
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int32), look)

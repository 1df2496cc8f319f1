"""Objects as convex parts, for engines without concave shapes: coacd's decomposition, kept in a cache."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import igl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.store.storage import temporary

THRESHOLD = 0.05
"""Largest concavity of a part, as a share of the object's size (Wei et al. 2022): coacd's default."""
THICKENED = 0.022
"""Distance from the surface, as a share of half of the object's largest extent, within which vertices of parts are moved to it: coacd
remeshes objects that are no closed manifolds, half as far outside (0.55 of its voxels), and every part would be too thick."""


def convex_parts(mesh: Mesh) -> list[NDArray[np.float64]]:
    """Split a mesh into convex parts.

    Parameters
    ----------
    mesh
        The object, world, m.

    Returns
    -------
    The vertices (N, 3), m, of each part, which is their convex hull. They are cached below `XDG_CACHE_HOME` by the mesh's hash.

    Raises
    ------
    InvalidInput
        coacd is not installed.
    """
    content = hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes() + repr((THRESHOLD, THICKENED)).encode()).hexdigest()
    path = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vt-pipeline" / "convex-parts" / f"{content}.npz"
    if not path.exists():
        parts = _decompose(mesh)
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary(path) as beside:
            with beside.open("wb") as file:
                np.savez(file, *parts)
            beside.replace(path)
    with np.load(path) as stored:
        return [stored[name] for name in stored.files]


def _decompose(mesh: Mesh) -> list[NDArray[np.float64]]:
    try:
        import coacd
    except ModuleNotFoundError as error:
        raise InvalidInput("convex parts need coacd; `pip install -c constraints.txt -e '.[mujoco]'` installs it") from error
    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=THRESHOLD, seed=0)
    return [_at_surface(np.asarray(vertices), mesh) for vertices, _ in parts]


def _at_surface(points: NDArray[np.float64], mesh: Mesh) -> NDArray[np.float64]:
    """Move the points (N, 3) that are near a mesh onto it."""
    squares, _, nearest = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces.astype(np.int64))
    reach = THICKENED * float(np.ptp(mesh.vertices, axis=0).max()) / 2
    return np.where((squares <= reach**2)[:, None], nearest, points)

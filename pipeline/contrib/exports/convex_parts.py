"""Objects as convex parts, for engines without concave shapes: coacd's decomposition, kept in a cache."""

import hashlib
import os
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import igl
import numpy as np
import trimesh

from pipeline.engine.keys import sources_hash
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.store.storage import temporary

THRESHOLD = 0.05  # largest concavity of a part, as a share of the object's size (Wei et al. 2022): coacd's default
CONVEX = 0.99  # share of its convex hull's volume from which on a piece counts as convex
THICKENED = 0.022
"""Distance from the surface, as a share of half of the object's largest extent, within which vertices of parts are moved to it: coacd
remeshes objects that are no closed manifolds, half as far outside (0.55 of its voxels), and every part would be too thick."""


def convex_parts(mesh: Mesh) -> list[Array]:
    """Split a mesh, m, into convex parts, each the hull of its vertices (N, 3); cached below `XDG_CACHE_HOME`, by mesh and code."""
    try:
        code = [sources_hash(__name__), version("coacd")]
    except PackageNotFoundError as error:
        raise InvalidInput("convex parts need coacd; `pip install -c constraints.txt -e '.[mujoco]'` installs it") from error
    content = hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes() + "".join(code).encode()).hexdigest()
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


def _decompose(mesh: Mesh) -> list[Array]:
    """Take the closed pieces of a mesh that are convex as they are, and split the others."""
    import coacd

    coacd.set_log_level("error")
    parts = []
    for piece in _pieces(mesh):
        hull = piece.convex_hull
        if piece.is_watertight and piece.volume >= CONVEX * hull.volume:  # an open one has a volume only by chance
            parts.append(np.array(hull.vertices))
        else:
            hulls = coacd.run_coacd(coacd.Mesh(piece.vertices, piece.faces), threshold=THRESHOLD, seed=0)
            parts += [_at_surface(np.asarray(vertices), piece) for vertices, _ in hulls]
    return parts


def _pieces(mesh: Mesh) -> list[trimesh.Trimesh]:
    """Split a mesh into its connected pieces; one that is open, or encloses a cavity, stays whole.

    Pieces of a closed mesh may overlap: the object is their union.
    """
    positions, inverse = np.unique(mesh.vertices, axis=0, return_inverse=True)
    body = trimesh.Trimesh(positions, inverse.reshape(-1)[mesh.faces], process=False)
    pieces = list(body.split(only_watertight=False, repair=False))
    return pieces if all(piece.is_watertight and piece.volume > 0 for piece in pieces) else [body]


def _at_surface(points: Array, mesh: trimesh.Trimesh) -> Array:
    """Move the points (N, 3) that are near a mesh onto it."""
    squares, _, nearest = igl.point_mesh_squared_distance(points, mesh.vertices, np.asarray(mesh.faces, np.int64))
    reach = THICKENED * float(np.ptp(mesh.vertices, axis=0).max()) / 2
    return np.where((squares <= reach**2)[:, None], nearest, points)

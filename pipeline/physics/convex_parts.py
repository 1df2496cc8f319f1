"""Objects as convex parts, for engines without concave shapes: coacd's decomposition, kept in a cache."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.store.storage import temporary

THRESHOLD = 0.05
"""Largest concavity of a part, as a share of the object's size (Wei et al. 2022): coacd's default."""


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
    content = hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes() + repr(THRESHOLD).encode()).hexdigest()
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
    return [np.asarray(vertices) for vertices, _ in coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=THRESHOLD, seed=0)]

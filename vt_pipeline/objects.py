"""Objects that sensors touch: a mesh, prepared once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pipeline.formats.mesh_file import load_mesh
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.face_culling import BoxedFaces, box_faces


@dataclass(frozen=True, eq=False)
class TouchObject:
    """A mesh in the object's frame, m, with its faces as sensors see them."""

    mesh: Mesh
    faces: BoxedFaces


def load_object(source: str | Path | tuple[ArrayLike, ArrayLike], *, scale: float = 1.0) -> TouchObject:
    """Prepare an object.

    Parameters
    ----------
    source
        A mesh file (.obj, .stl, .ply, .glb, .dae, …), or vertices (V, 3) and faces (F, 3).
    scale
        Metres per unit of the source.

    Returns
    -------
    The object in the frame of its source: it is neither moved nor turned.

    Raises
    ------
    InvalidInput
        The file cannot be read, or a corner is NaN or infinite.

    Examples
    --------
    >>> mug = load_object("mug.glb")
    >>> slab = load_object(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), scale=1e-3)
    """
    mesh = load_mesh(Path(source)) if isinstance(source, str | Path) else Mesh.bare(np.asarray(source[0], float), np.asarray(source[1]))
    mesh = replace(mesh, vertices=scale * mesh.vertices)
    return TouchObject(mesh, box_faces(mesh.triangles))

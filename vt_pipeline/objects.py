"""Objects that sensors touch: a mesh, prepared once."""

from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pipeline.errors import InvalidInput
from pipeline.formats.file_units import stated_units
from pipeline.formats.mesh_reader import load_mesh
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.ray_depth import BoxedFaces, box_faces

Source = str | Path | tuple[ArrayLike, ArrayLike]  # what an object is made from: a mesh file, or vertices and faces


@dataclass(frozen=True, eq=False)
class TouchObject:
    """A mesh in the object's frame, m, with its faces as sensors see them."""

    mesh: Mesh
    faces: BoxedFaces

    def __repr__(self) -> str:
        sides = np.ptp(self.mesh.vertices, axis=0) if len(self.mesh.vertices) else np.zeros(3)
        return f"TouchObject({len(self.mesh.faces)} faces, {' x '.join(f'{side:.3g}' for side in sides)} m)"


def load_object(source: Source, *, scale: float | None = None) -> TouchObject:
    """Prepare an object.

    Parameters
    ----------
    source
        A mesh file (.obj, .stl, .ply, .glb, .dae, …), or vertices (V, 3) and faces (F, 3).
    scale
        Metres per unit of the source; by default what glTF, COLLADA and 3MF files state, else 1.

    Returns
    -------
    The object in the frame of its source: it is neither moved nor turned.

    Raises
    ------
    InvalidInput
        There is no such file, it cannot be read, vertices and faces do not fit each other, or a corner is NaN or too far away.
    TypeError
        The source is something else.

    Examples
    --------
    >>> mug = load_object("mug.glb")
    >>> slab = load_object(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), scale=1e-3)
    """
    if scale is None:
        scale = (stated_units(Path(source))[0] if isinstance(source, str | Path) else None) or 1.0
    if isinstance(scale, bool) or not isinstance(scale, Real):
        raise TypeError(f"scale is metres per unit of the source, a number; this is {type(scale).__name__}")
    if not 0 < scale < np.inf:
        raise InvalidInput(f"scale is {scale}; it must be above 0")
    if isinstance(source, str | Path):
        if not Path(source).is_file():
            raise InvalidInput(f"{source}: file not found")
        mesh = load_mesh(Path(source))
    elif isinstance(source, tuple | list) and len(source) == 2:
        mesh = Mesh.bare(*_checked(*source))
    else:
        raise TypeError(f"an object is a mesh file, vertices and faces, or what load_object returns; this is {type(source).__name__}")
    mesh = replace(mesh, vertices=scale * mesh.vertices)
    return TouchObject(mesh, box_faces(mesh.triangles))


def _checked(given_vertices: ArrayLike, given_faces: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces as arrays, if they form a mesh."""
    try:
        vertices, faces = np.asarray(given_vertices), np.asarray(given_faces)
        if vertices.dtype.kind == "c":
            raise TypeError("they are complex")
        vertices = vertices.astype(float, copy=False)
    except (TypeError, ValueError) as error:
        raise TypeError(f"vertices (V, 3) and faces (F, 3) are arrays of numbers; these are not: {error}") from error
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise InvalidInput(f"vertices have shape {vertices.shape}, faces {faces.shape}; they must be (V, 3) and (F, 3)")
    if faces.size and (faces.dtype.kind not in "iu" or faces.min() < 0 or faces.max() >= len(vertices)):
        numbers = f"{faces.dtype} from {faces.min()} to {faces.max()}"
        raise InvalidInput(f"faces hold numbers of {len(vertices)} vertices, integers from 0 to {len(vertices) - 1}; these are {numbers}")
    return vertices, faces.astype(np.int64)


def as_object(source: TouchObject | Source) -> TouchObject:
    """Return an object as it is, or load it from its source."""
    return source if isinstance(source, TouchObject) else load_object(source)

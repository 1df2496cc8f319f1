"""Write reconstructions as mesh files for other programs: OBJ, PLY or GLB, by suffix."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.drawing.colors import TOUCH_COLOR, VISION_COLORS, Y_UP, Opaque, linear_colors
from pipeline.errors import InvalidInput, StageError
from pipeline.kernels.arrays import Array, Integers, Mask
from pipeline.kernels.charts.vision_charts import CHART_VERTICES
from pipeline.kernels.geometry.closed_surface import vertex_normals
from pipeline.kernels.geometry.exterior_sampling import RayScene
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import optical_centre
from pipeline.models.reconstruction import Reconstruction, join_vision_charts
from pipeline.store.atomic import write_atomically

SUFFIXES = (".obj", ".ply", ".glb")
STEEPEST = 0.1  # cosine between normal and view below which a vertex is on the rim, where pixels may show the background
OFFSET = 1e-3  # of a ray's start from a surface over the surface's diagonal
UPRIGHT = np.eye(4)  # a frame with z up, in metres

Parts = list[tuple[str, trimesh.Trimesh]]


@dataclass(frozen=True)
class ClosedMesh:
    """The closed mesh of a reconstruction, coloured where an image shows it."""

    vertices: NDArray[np.float64]  # (V, 3), in the frame and unit of the reconstruction
    faces: NDArray[np.integer]  # (F, 3), normals outwards
    colors: NDArray[np.uint8]  # (V, 3) sRGB, from the image
    seen: NDArray[np.bool_]  # (V,): whether the image shows the vertex; the others have no colour

    @classmethod
    def grey(cls, vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> Self:
        """Make a closed mesh of which no image shows anything."""
        return cls(vertices, faces, np.zeros((len(vertices), 3), np.uint8), np.zeros(len(vertices), bool))

    def coloured(self, image: NDArray[np.uint8], matrix: NDArray[np.float64], mask: NDArray[np.bool_]) -> Self:
        """Colour the vertices that an image shows; parameters as of `seen_colors`."""
        colors, seen = seen_colors(self.vertices, self.faces, image, matrix, mask)
        return replace(self, colors=colors, seen=seen)

    @property
    def painted(self) -> NDArray[np.uint8]:  # (V, 4) sRGB
        """The colours, grey where no image shows the mesh."""
        return np.where(self.seen[:, None], np.insert(self.colors, 3, 255, axis=1), np.array(VISION_COLORS[0], np.uint8))


def write_charts(
    path: Path,
    reconstruction: Reconstruction,
    to_metres: NDArray[np.float64] = UPRIGHT,  # (4, 4) from the reconstruction's frame to metres with z up, for GLB, which turns it to y up
    *,
    joined: bool = False,  # the vision charts as one closed surface: vertices that coincided before the deformation become their mean
) -> None:
    """Write a reconstruction's charts separately: each has its own vertices, colour and, in OBJ and GLB, its own named object.

    Touch charts are orange and called touch_N, vision charts vision_N, or vision. Lengths and frame are the reconstruction's, but for GLB's
    node. PLY and GLB hold float32, OBJ eight decimals: 0.03 µm and 5 nm in the scene.
    """
    vision, side = reconstruction.vision, reconstruction.side
    if joined:
        parts = [("vision", _mesh(*join_vision_charts(reconstruction), VISION_COLORS[0]))]
    elif reconstruction.is_whole:
        parts = [("surface", _mesh(reconstruction.vertices, reconstruction.faces, VISION_COLORS[0]))]
    else:
        parts = _charts(reconstruction, "vision_{:03d}", range(0, vision, CHART_VERTICES), VISION_COLORS)
    parts += _charts(reconstruction, "touch_{:02d}", range(vision, len(reconstruction.vertices), side**2), (TOUCH_COLOR,))
    _write(path, parts, to_metres)


def write_closed(path: Path, mesh: ClosedMesh, to_metres: NDArray[np.float64] = UPRIGHT) -> None:
    """Write one closed mesh, called closed, grey where no image shows it; frames as `write_charts`."""
    _write(path, [("closed", _mesh(mesh.vertices, mesh.faces, mesh.painted))], to_metres)


def _charts(reconstruction: Reconstruction, name: str, starts: range, colors: Sequence[Opaque]) -> Parts:
    """Make the charts whose first vertices are `starts`, each with its number in its name."""
    parts = []
    for number, start in enumerate(starts):
        stop = start + starts.step
        faces = reconstruction.faces[((reconstruction.faces >= start) & (reconstruction.faces < stop)).all(axis=1)] - start
        parts.append((name.format(number), _mesh(reconstruction.vertices[start:stop], faces, colors[number % len(colors)])))
    return parts


def _mesh(vertices: np.ndarray, faces: np.ndarray, color: Opaque | NDArray[np.uint8]) -> trimesh.Trimesh:
    if not np.isfinite(vertices).all():
        count = np.count_nonzero(~np.isfinite(vertices).all(axis=1))
        raise StageError(f"{count} of {len(vertices)} vertices hold NaN or infinity, which mesh files cannot hold; check the inputs")
    colors = np.broadcast_to(np.array(color, np.uint8), (len(vertices), 4)).copy()
    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)


def check_output(path: Path) -> None:
    """Raise an `InvalidInput` if the path is a folder or below a file, or its suffix is not a mesh's."""
    if path.suffix.lower() not in SUFFIXES:
        raise InvalidInput(f"{path}: the suffix {path.suffix or '(none)'} names no mesh format; use {', '.join(SUFFIXES)}")
    if path.is_dir():
        raise InvalidInput(f"{path} is a folder; name a file to write")
    if files := [parent for parent in path.parents if parent.is_file()]:
        raise InvalidInput(f"{path}: {files[0]} is a file; name a folder")


def _write(path: Path, parts: Parts, to_metres: NDArray[np.float64]) -> None:
    """Write named meshes into one file, at once."""
    suffix = path.suffix.lower()
    scene: Any = trimesh.Scene()
    node = Y_UP @ to_metres
    for name, mesh in parts:
        if suffix == ".glb":
            visual: Any = mesh.visual
            visual.vertex_colors = linear_colors(visual.vertex_colors)
        scene.add_geometry(mesh, node_name=name, geom_name=name, transform=node if suffix == ".glb" else None)
    content = scene.export(file_type=suffix[1:])
    write_atomically(path, content.encode() if isinstance(content, str) else content)


def seen_colors(
    vertices: Array,  # (V, 3) world, m
    faces: Integers,  # (F, 3) normals outwards
    image: NDArray[np.uint8],  # (rows, cols, 3)
    matrix: Array,  # (3, 4) the image's projection matrix, from `projection_matrix`
    shown: Mask,  # (rows, cols) where the image shows the object, and no background or hand
) -> tuple[NDArray[np.uint8], Mask]:  # (V, 3) 0 where not seen, (V,)
    """Look up the colours of vertices in an image, and which are seen: those that face the camera, unoccluded, in a shown pixel."""
    rows, cols = shown.shape
    to_camera = optical_centre(matrix) - vertices
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    pixels = project_points(matrix, vertices)
    in_image = ((pixels >= 0) & (pixels < [cols, rows])).all(axis=1)  # NaN behind the camera is not
    seen = in_image & ((vertex_normals(vertices, faces) * to_camera).sum(axis=1) > STEEPEST)
    col, row = pixels[seen].astype(np.int64).T
    seen[seen] = shown[row, col]
    seen[seen] = RayScene(vertices, faces).escape(vertices[seen], to_camera[seen], OFFSET)
    colors = np.zeros((len(vertices), 3), np.uint8)
    col, row = pixels[seen].astype(np.int64).T
    colors[seen] = image[row, col]
    return colors, seen

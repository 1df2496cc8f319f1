"""PLY files: polygons and triangle strips, colours under their several names, and textures of one or more pages."""

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_file
from pipeline.formats.image_file import MAX_BYTES, read_array
from pipeline.formats.mesh_companions import Companions, texture_names
from pipeline.formats.mesh_parts import build_part, cut_polygons, eight_bits, split_vertices, strip_corners
from pipeline.formats.ply_elements import Element, read_elements
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import unit_vectors

COLORS = [  # names of the properties of a colour, the last of which may be missing
    tuple(prefix + channel for channel in channels)
    for prefix, channels in product(("", "diffuse_"), (("red", "green", "blue", "alpha"), ("r", "g", "b", "a")))
]
COLOR_LIKE = re.compile(r"(?!ambient|specular|emissive).*(?:red|green|blue|colou?r|rgb)|intensity$|gr[ae]y$|material_index$")
"""Names of properties that look like a colour."""
COORDINATES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))  # names of the texture coordinates of a vertex
MAX_POINTS = 1_000_000  # of a touch
PAGES = ("texnumber", "texindex", "tex_index", "texture_index", "texture_number")
"""Names of the property of a face, or of a vertex, that numbers its texture from 0."""


def read_ply(file: Companions, images: Textures) -> list[Mesh]:
    """Read the surface of a PLY file, with its textures."""
    unread = file.unread
    elements = read_elements(file.content, unread)
    named = {element.name: element for element in elements}
    vertex = named.pop("vertex", Element("vertex", 0))
    if (vertices := vertex.columns("x", "y", "z")) is None:
        return []
    vertices = vertices.astype(np.float64)
    face = named.pop("face", Element("face", 0))
    corners, sizes, indices = _polygons(face)
    strips = np.concatenate([np.empty((0, 3), np.int64), *(_cut_strips(named.pop(name)) for name in list(named) if "strip" in name)])
    for element in named.values():
        if element.length and any("vert" in name and not name.startswith("tex") for name in element.sizes):
            raise InvalidInput(f"it has {element.name} with lists of vertices, which cannot be read; export it as triangles")
        if element.length and element.name != "camera":
            unread.append(f"elements of the PLY that are no faces are not read: {element.name} ({element.length})")
    triangles, polygon = cut_polygons(corners, sizes, vertices, unread)
    faces = np.concatenate([corners[triangles], strips])
    if not len(faces):
        return []
    header = file.content.partition(b"end_header")[0]
    textures = [images.find(name, opaque=True) for name in texture_names(header)]
    vertex_color, face_color = _colors(vertex, unread), _colors(face, unread)
    if vertex_color is not None and face_color is not None:
        unread.append("colours of faces are not read beside those of vertices")
        face_color = None
    if len(strips) and face_color is not None:
        unread.append("colours of faces are not read beside triangle strips")
        face_color = None
    uv = None
    if any(texture is not None for texture in textures) and (uv := _corner_uv(vertex, face, indices, triangles, polygon, faces)) is None:
        unread.append("the texture of the PLY is not read: it has no texture coordinates")
    if uv is None:
        face_color = None if face_color is None else face_color[polygon]
        return [build_part(vertices, faces, face_color=face_color, vertex_color=vertex_color)]
    if any(color is not None and (color != 255).any() for color in (vertex_color, face_color)):
        unread.append("colours of the PLY are not read beside its texture")
    page = _pages(vertex, face, polygon, faces, len(textures), unread)
    page[np.isnan(uv).any(axis=(1, 2))] = -1
    pairs, values = np.unique(np.ascontiguousarray(uv, np.float32).view(np.uint64).reshape(-1, 3), return_inverse=True)
    vertex_of, value_of, faces = split_vertices(faces, values.reshape(-1, 3))
    uv_of = pairs.view(np.float32).reshape(-1, 2)[value_of]
    return [build_part(vertices[vertex_of], faces, uv=uv_of, page=page, textures=textures)]


def read_points(path: Path) -> Array:  # (N, 6)
    """Read points and unit normals from a PLY file with nx, ny, nz, or a .npy file (N, 6)."""
    if path.suffix.lower() == ".npy":
        points: NDArray[Any] | None = read_array(path)
        lacking = "it must hold numbers (N, 6)"
    else:
        try:
            elements = read_elements(read_file(path, MAX_BYTES), [])
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from error
        vertex = next((element for element in elements if element.name == "vertex"), None)
        points = None if vertex is None else vertex.columns("x", "y", "z", "nx", "ny", "nz")
        lacking = "its vertices need x, y, z, nx, ny, nz: `read-touch` writes them"
    if points is None or points.ndim != 2 or points.shape[1] != 6 or points.dtype.kind not in "fiu":
        raise InvalidInput(f"{path} holds no points with normals: {lacking}")
    if len(points) > MAX_POINTS or not np.isfinite(points).all():
        raise InvalidInput(f"{path} has {len(points)} points; at most {MAX_POINTS} are read, and all must be finite")
    points = points.astype(np.float64)
    points[:, 3:] = unit_vectors(points[:, 3:])
    return points


def _polygons(face: Element) -> tuple[NDArray[np.int64], NDArray[np.int64], str]:
    """Return the corners of all faces, one after the other, the number of each face's corners, and the name of their list."""
    usual = [name for name in ("vertex_indices", "vertex_index") if name in face.sizes]
    others = [of.name for of in face.properties if of.name in face.sizes and of.type.kind in "iu" and not of.name.startswith("tex")]
    name = next(iter([*usual, *others]), "")
    if face.length and not name:
        raise InvalidInput(f"its {face.length} faces have no list of their vertices; write it again with another program")
    return face.values.get(name, np.empty(0)).astype(np.int64), face.sizes.get(name, np.empty(0, np.int64)), name


def _cut_strips(element: Element) -> NDArray[np.int64]:
    """Cut strips, each row one or several with -1 in between, into triangles (T, 3)."""
    corners, sizes, _ = _polygons(element)
    ends = np.union1d(np.flatnonzero(corners < 0), np.cumsum(sizes))
    strips = [strip[strip >= 0] for strip in np.split(corners, ends)]
    return np.concatenate([np.empty((0, 3), np.int64), *(strip[strip_corners(len(strip))] for strip in strips if len(strip) > 2)])


def _colors(element: Element, unread: list[str]) -> NDArray[np.uint8] | None:
    """Read the colours (N, 4) of an element's rows."""
    for *names, opacity in COLORS:
        if (levels := element.columns(*names)) is not None and len(levels):
            colors = eight_bits(_unsigned(levels), fractions=levels.dtype.kind == "f")
            if (levels := element.columns(opacity)) is not None:
                colors[:, 3] = eight_bits(_unsigned(levels), fractions=levels.dtype.kind == "f")[:, 0]
            return colors
    if element.length and (names := [name for name in element.values if COLOR_LIKE.match(name)]):
        unread.append(f"colours of each {element.name} ({', '.join(names)}) are not read")
    return None


def _unsigned(levels: NDArray[Any]) -> NDArray[Any]:
    """Read signed bytes, which some programs declare, as unsigned ones."""
    return levels if levels.dtype.kind == "f" else levels + np.int64(256) * (levels < 0)


def _corner_uv(
    vertex: Element, face: Element, indices: str, triangles: NDArray[np.int64], polygon: NDArray[np.int64], faces: NDArray[np.int64]
) -> Array | None:
    """Read texture coordinates (F, 3, 2) of triangles from a list per polygon, or from vertices; NaN where there are none."""
    if name := next((of.name for of in face.properties if of.name in face.sizes and of.type.kind == "f" and of.name != indices), None):
        sizes, corner_sizes = face.sizes[name], face.sizes[indices]
        start = (np.cumsum(sizes) - sizes)[polygon, None] + 2 * (triangles - (np.cumsum(corner_sizes) - corner_sizes)[polygon, None])
        fits = np.flatnonzero((sizes == 2 * corner_sizes)[polygon])
        uv = np.full((len(faces), 3, 2), np.nan)
        uv[fits] = face.values[name][start[fits, :, None] + np.arange(2)]
        return uv
    for names in COORDINATES:
        if (coordinates := vertex.columns(*names)) is not None:
            return coordinates[faces].astype(np.float64)
    return None


def _pages(
    vertex: Element, face: Element, polygon: NDArray[np.int64], faces: NDArray[np.int64], count: int, unread: list[str]
) -> NDArray[np.int64]:
    """Read the number (F,) of the texture of each triangle, -1 for none."""
    pages = np.full(len(faces), -1, np.int64)
    for name in PAGES:
        if name in face.values and name not in face.sizes:
            pages[: len(polygon)] = face.values[name][polygon]
            break
        if name in vertex.values and name not in vertex.sizes:
            pages[:] = vertex.values[name][faces[:, 0]]
            break
    else:
        if count > 1:
            unread.append(f"{count} textures are not read: no property such as {PAGES[0]} says which faces use which")
        pages[:] = 0 if count == 1 else -1
    if wrong := np.count_nonzero(pages >= count):
        unread.append(f"textures of triangles are not read ({wrong}): their number is beyond the {count} of the PLY")
    return np.where(pages < count, pages, -1)

"""What readers of mesh files share: limits, numbers, polygons as triangles, and parts of a mesh with their look."""

import re
import warnings
from collections.abc import Sequence
from typing import Any

import mapbox_earcut
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats, Integers, Mask
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import transform_points, unit_vectors

MAX_UV = 2.0**20  # repeats of a texture beyond which float32 cannot tell its pixels apart: such coordinates are damaged, and become 0
GREY = (178, 178, 178, 255)  # the colour of faces without a material, as 3D Warehouse's default material
OPAQUE_WHITE = (255, 255, 255, 255)
MAX_FACES = 2_000_000  # of a mesh file, and a third of its vertices; more would take gigabytes, whatever `max_faces` allows
MAX_INSTANCES = 100_000  # maximum number of nodes or components of a scene, counted each time that they are used
MAX_DEPTH = 100  # maximum depth of nodes or components within others
TURN = 1e-6  # sine of the turn at a corner, against the polygon's sense, from which it counts as concave


def check_count(what: str, number: int, limit: int, remedy: str) -> None:
    """Refuse a mesh file with too many faces, vertices, pixels, …."""
    if number > limit:
        raise InvalidInput(f"it has {number} {what}, {limit} are the most; {remedy}")


def check_mesh(faces: int, vertices: int) -> None:
    """Refuse a mesh file with too many faces or vertices."""
    check_count("faces", faces, MAX_FACES, "decimate the mesh")
    check_count("vertices", vertices, 3 * MAX_FACES, "decimate the mesh")


def check_corners(corners: Integers, vertices: int) -> None:
    """Refuse faces that name a vertex beyond the number that there is."""
    if corners.size and not (corners.min() >= 0 and corners.max() < vertices):
        raise InvalidInput(f"a face names a vertex outside 0..{vertices - 1}; the file is damaged")


def read_numbers(text: bytes) -> Array:
    """Read the numbers between blanks; refuse other text."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what earlier versions of NumPy raise
        try:
            return np.fromstring(text, np.float64, sep=" ")
        except (ValueError, DeprecationWarning) as error:
            other = next((word for word in text.split() if not _is_number(word)), b"")[:40].decode("latin-1")
            remedy = "write decimal points in place of commas" if re.fullmatch(r"[-+\d]+,\d+", other) else "the file is damaged"
            raise InvalidInput(f"it has {other!r} where a number is expected; {remedy}") from error


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def line_widths(lines: Sequence[bytes]) -> NDArray[np.int64]:
    """Count the words of lines, (N,)."""
    return np.array([len(line.split()) for line in lines], np.int64)


def read_columns(lines: Sequence[bytes], count: int) -> Array:
    """Read the first numbers (N, count) of lines, NaN where a line has fewer."""
    numbers, widths = read_numbers(b" ".join(lines)), line_widths(lines)
    firsts, table = np.cumsum(widths) - widths, np.full((len(lines), count), np.nan)
    for column in range(count):
        has = widths > column
        table[has, column] = numbers[(firsts + column)[has]]
    return table


def eight_bits(colors: NDArray[Any], *, fractions: bool) -> NDArray[np.uint8]:
    """Scale colours (N, 3 or 4) to (N, 4) uint8 by the range that they use: 0 to 1 (of fractions alone), 255, or 65535."""
    stored = np.clip(np.nan_to_num(np.asarray(colors, np.float64)), 0, 65535)
    largest = stored.max(initial=0)
    limit = next(limit for limit in ((1, 255, 65535) if fractions else (255, 65535)) if largest <= limit)
    scaled = np.full((len(stored), 4), 255, np.uint8)
    scaled[:, : stored.shape[1]] = np.rint(stored * (255 / limit))
    return scaled


def triangulate(
    corners: Integers,  # (C,) vertices of all polygons, one polygon after the other
    sizes: Integers,  # (P,) corners of each polygon; fewer than three give no triangle
    vertices: Array,  # (V, 3)
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # (T, 3) indices into `corners`, in the order of the polygons; (T,) the polygon of each
    """Cut polygons into triangles: fans, of concave ones ears."""
    firsts = np.cumsum(sizes) - sizes
    pieces, numbers = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for size in np.unique(sizes[sizes >= 3]):
        polygons = np.flatnonzero(sizes == size)
        fan = np.stack([np.zeros(size - 2, np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
        fan[1:] = np.roll(fan[1:], -1, axis=1)  # 0 1 2, 2 3 0, 3 4 0 …: trimesh cuts quadrilaterals so
        cut = np.tile(fan, (len(polygons), 1, 1))
        if size > 3:
            positions = vertices[corners[firsts[polygons, None] + np.arange(size)]]
            for number in np.flatnonzero(is_concave(positions)):
                ears = ear_clip(positions[number])
                cut[number] = ears if len(ears) == size - 2 else fan
        pieces.append((firsts[polygons, None, None] + cut).reshape(-1, 3))
        numbers.append(np.repeat(polygons, size - 2))
    polygon = np.concatenate(numbers)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(pieces)[order], polygon[order]


def cut_polygons(corners: Integers, sizes: Integers, vertices: Array, unread: list[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Check the polygons of a file, and cut them as `triangulate` does; note those of fewer than three corners."""
    check_corners(corners, len(vertices))
    check_mesh(int(np.maximum(sizes - 2, 0).sum()), len(vertices))
    if lines := np.count_nonzero(sizes < 3):
        unread.append(f"faces of fewer than three corners are not read ({lines})")
    return triangulate(corners, sizes, vertices)


def strip_corners(count: int, *, fan: bool = False) -> NDArray[np.int64]:
    """List the corners (T, 3) of the triangles of a strip, of which every other one is turned, or of a fan."""
    first = np.arange(max(count - 2, 0))
    if fan:
        return np.stack([0 * first, first + 1, first + 2], axis=1)
    turned = first % 2
    return np.stack([first + turned, first + 1 - turned, first + 2], axis=1)


def is_concave(corners: Array) -> Mask:
    """Whether polygons (P, N, 3) turn against their own sense at a corner."""
    sides = np.roll(corners, -1, axis=1) - corners
    lengths, normal = np.linalg.norm(sides, axis=2), _normal(corners)
    turns = (np.cross(np.roll(sides, 1, axis=1), sides) * normal[:, None]).sum(axis=2)
    limit = TURN * lengths * np.roll(lengths, 1, axis=1) * np.linalg.norm(normal, axis=1)[:, None]
    return np.asarray((turns < -limit).any(axis=1))


def ear_clip(corners: Array) -> Integers:
    """Cut a polygon (N, 3), as seen along its normal, into triangles (T, 3) of its corners."""
    normal, sides = _normal(corners), np.roll(corners, -1, axis=0) - corners
    across = sides[np.linalg.norm(sides, axis=1).argmax()]
    plane = np.stack([across / np.linalg.norm(across), np.cross(normal, across) / np.linalg.norm(np.cross(normal, across))], axis=1)
    return np.asarray(
        mapbox_earcut.triangulate_float64(np.ascontiguousarray(corners @ plane), np.array([len(corners)], np.uint32))
    ).reshape(-1, 3)


def _normal(corners: Array) -> Array:
    """Compute twice the area of polygons (…, N, 3) as vectors (…, 3)."""
    spokes = corners - corners[..., :1, :]
    return np.asarray(np.cross(spokes, np.roll(spokes, -1, axis=-2)).sum(axis=-2))


def unique_materials(
    color: NDArray[np.uint8],  # (N, 4)
    texture: Integers,  # (N,) number of the texture, -1 for none
) -> tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.int32]]:  # (M, 4), (M,) of the materials, and (N,) the material of each row
    """Find the different materials."""
    packed = np.ascontiguousarray(color, np.uint8).view(np.uint32).reshape(-1)  # with the texture one number, which sorts fast
    materials, material = np.unique((texture.astype(np.int64) + 1) << 32 | packed, return_inverse=True)
    colors = materials.astype(np.uint32).view(np.uint8).reshape(-1, 4)
    return colors, ((materials >> 32) - 1).astype(np.int32), material.reshape(-1).astype(np.int32)


def build_part(
    vertices: Array,  # (V, 3)
    faces: Integers,  # (F, 3)
    *,
    face_color: NDArray[np.uint8] | None = None,  # (F, 4)
    vertex_color: NDArray[np.uint8] | None = None,  # (V, 4)
    uv: Floats | None = None,  # (V, 2)
    page: Integers | None = None,  # (F,) index in `textures`, -1 for none
    textures: Sequence[NDArray[np.uint8] | None] = (),
) -> Mesh:
    """Build a mesh; faces without a colour of their own are grey, or white where vertices or a texture colour them."""
    check_corners(faces, len(vertices))
    check_mesh(len(faces), len(vertices))
    page = np.full(len(faces), -1) if page is None or uv is None else page
    kept = [number for number in np.unique(page[page >= 0]).tolist() if textures[number] is not None]
    page = np.where(np.isin(page, kept), np.searchsorted(kept, page), -1)
    if face_color is None:
        blank = GREY if vertex_color is None else OPAQUE_WHITE
        face_color = np.where((page < 0)[:, None], np.array(blank, np.uint8), np.array(OPAQUE_WHITE, np.uint8))
    base_color, material_texture, face_material = unique_materials(face_color, page)
    coordinates = np.zeros((len(vertices), 2)) if uv is None else np.asarray(uv, np.float64)
    look = Look(
        uv=np.where(np.abs(coordinates) < MAX_UV, coordinates, 0).astype(np.float32),  # NaN too
        face_material=face_material,
        base_color=base_color,
        material_texture=material_texture,
        textures=tuple(texture for number in kept if (texture := textures[number]) is not None),
        vertex_color=vertex_color,
    )
    return Mesh(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int32), look)


def pose_matrix(translation: ArrayLike, rotation: ArrayLike, scale: ArrayLike) -> Array:
    """Compose translations (..., 3), quaternions x, y, z, w (..., 4) of any length and scales (..., 3) into matrices (..., 4, 4)."""
    x, y, z, w = np.moveaxis(unit_vectors(np.asarray(rotation, np.float64)), -1, 0)
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    axes = np.moveaxis(np.array(turn), (0, 1), (-2, -1)) * np.asarray(scale, np.float64)[..., None, :]
    pose = np.zeros((*np.broadcast_shapes(axes.shape[:-2], np.shape(translation)[:-1]), 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = axes, translation, 1
    return pose


def mirrors(matrices: Array) -> Mask:
    """Whether matrices (..., 4, 4) turn a left hand into a right one."""
    axes = matrices[..., :3, :3]
    return np.asarray((np.cross(axes[..., 0, :], axes[..., 1, :]) * axes[..., 2, :]).sum(axis=-1) < 0)


def posed(pose: Array, vertices: Array, faces: Integers) -> tuple[Array, Integers]:
    """Move vertices (V, 3) by a pose (4, 4); turn faces (F, 3) where it mirrors them, so that the outside stays outside."""
    return transform_points(pose, vertices), faces[:, ::-1] if mirrors(pose) else faces


def split_vertices(
    faces: Integers,  # (F, 3)
    values: Integers,  # (F, 3) a number >= 0 per corner, of its colour or texture coordinates
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Give each vertex one value: (V,) the old vertex and (V,) the value of each new one, and (F, 3) new faces."""
    count = int(values.max(initial=0)) + 1
    unique, new_faces = np.unique(np.asarray(faces, np.int64) * count + values, return_inverse=True)
    vertex, value = np.divmod(unique, count)
    return vertex, value, new_faces.reshape(-1, 3)

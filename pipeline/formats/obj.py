"""OBJ files: polygons with texture coordinates, colours of vertices and materials, in lines of every form that programs write."""

import re
from collections.abc import Collection, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import decode_text
from pipeline.formats.mesh_companions import LIBRARY, Companions
from pipeline.formats.mesh_parts import (
    GREY,
    OPAQUE_WHITE,
    build_part,
    cut_polygons,
    eight_bits,
    line_widths,
    read_columns,
    read_numbers,
    split_vertices,
)
from pipeline.formats.obj_materials import Material, read_material
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Array, Integers
from pipeline.kernels.geometry.mesh import Mesh

OTHER_SURFACES = (b"surf", b"bzp", b"bsp", b"cdp", b"fo")  # free forms, and statements of the first version of the format
NO_MATERIAL = ("", "none", "(null)", "null", "default")  # names that programs write where faces have no material
EDGE = 0.5 + 1e-6  # distance of a texture coordinate from 0.5 beyond which it is outside the texture


def read_obj(file: Companions, textures: Textures) -> list[Mesh]:
    """Read the faces of an OBJ file, with the materials of its libraries."""
    text = file.content if file.content.isascii() else decode_text(file.content).encode()
    positions, coordinates, polygons = list[bytes](), list[bytes](), list[bytes]()
    names, used, current = {"": 0}, list[int](), 0  # of materials; the number of each polygon's
    lines = iter(text.splitlines())
    for line in lines:
        while line.endswith(b"\\") and not line.lstrip().startswith(b"#"):  # it continues
            line = line[:-1] + b" " + next(lines, b"")
        word, *rest = line.split(None, 1) or (b"",)
        values = rest[0].partition(b"#")[0] if rest else b""
        if word == b"v":
            positions.append(values)
        elif word == b"vt":
            coordinates.append(values)
        elif word == b"f":
            polygons.append(_absolute(values, len(positions), len(coordinates)) if b"-" in values else values)
            used.append(current)
        elif word.lower() == b"usemtl":
            current = names.setdefault(" ".join(rest[0].decode().split()) if rest else "", len(names))
        elif word in OTHER_SURFACES:
            raise InvalidInput(f"it has free-form or outdated surfaces ({word.decode()}), which cannot be read; export it as polygons")
    if b"\n#MRGB " in text:  # as ZBrush writes them
        file.unread.append("colours of vertices in comments (#MRGB) are not read")
    if not positions or not polygons:
        return []
    vertices, vertex_color = _vertices(positions)
    corners, numbers = _corners(b" ".join(polygons), len(coordinates))
    sizes = line_widths(polygons)
    triangles, polygon = cut_polygons(corners, sizes, vertices, file.unread)
    material = np.array(used, np.int64)[polygon]
    vertex, number, faces = split_vertices(corners[triangles], numbers[triangles])
    uv = np.concatenate([np.zeros((1, 2)), read_columns(coordinates, 2)])[number]
    colors, images = list[NDArray[np.uint8]](), list[NDArray[np.uint8] | None]()
    for stated, definitions in zip(names, _find_materials(names, file), strict=True):
        color, image, clamped = np.array(GREY if vertex_color is None else OPAQUE_WHITE, np.uint8), None, ""
        if definitions:
            color, image, clamped = read_material(stated, definitions[-1], textures)
        if clamped and (np.abs(uv[faces[material == len(colors)]] - 0.5) > EDGE).any():
            file.unread.append(clamped)
        colors.append(color)
        images.append(image)
    return [
        build_part(
            vertices[vertex],
            faces,
            face_color=np.array(colors)[material],
            vertex_color=None if vertex_color is None else vertex_color[vertex],
            uv=uv,
            page=np.where((numbers[triangles] == 0).any(axis=1), -1, material),
            textures=images,
        )
    ]


def _absolute(corners: bytes, vertices: int, coordinates: int) -> bytes:
    """Write the corners of a face with absolute numbers of its vertices and texture coordinates, of which so many precede it."""
    written = list[bytes]()
    for corner in corners.split():
        parts = [
            b"%d" % (before + 1 + int(part)) if part[:1] == b"-" else part
            for part, before in zip(corner.split(b"/"), (vertices, coordinates), strict=False)
        ]
        if parts[0][:1] == b"-" or int(parts[0]) < 1:
            raise InvalidInput(f"a face has relative index {corner.decode().partition('/')[0]}, before the first vertex; it is damaged")
        written.append(b"/".join(parts))
    return b" ".join(written)


def _corners(text: bytes, coordinates: int) -> tuple[Integers, Integers]:
    """Read the vertices of corners from 0, and their texture coordinates from 1, 0 for none."""
    corners = read_numbers(re.sub(rb"/\S*", b"", text)).astype(np.int64) - 1
    if (corners < 0).any():
        raise InvalidInput("a face names vertex 0, the first one is 1; write it again with another program")
    if not coordinates or b"/" not in text:
        return corners, np.zeros_like(corners)
    numbers = read_numbers(re.sub(rb"[^\s/]+/?([^\s/]*)\S*", rb"0\1", text)).astype(np.int64)
    return corners, np.where(numbers > coordinates, 0, numbers)


def _vertices(lines: Sequence[bytes]) -> tuple[Array, NDArray[np.uint8] | None]:
    """Read positions (V, 3) and the colours (V, 4) behind them, white where there are none."""
    table = read_columns(lines, 6)
    if (line_widths(lines) < 3).any():
        raise InvalidInput("a vertex has fewer than three numbers; the file is damaged")
    if not (has := ~np.isnan(table[:, 5])).any():
        return table[:, :3], None
    colors = np.full((len(lines), 4), 255, np.uint8)
    colors[has] = eight_bits(table[has, 3:], fractions=True)
    return table[:, :3], colors


def _find_materials(stated: Collection[str], file: Companions) -> list[list[Material]]:
    """Find the definitions of materials, also with a comment behind the name or in another case; note unknown ones."""
    folded = {name.lower(): name for name in file.materials}
    undefined, several, materials = list[str](), list[str](), list[list[Material]]()
    for name in stated:
        candidates = [part.strip() for part in (name, name.partition("#")[0])]  # a name may contain it
        known = [*candidates, *(folded.get(part.lower(), "") for part in candidates)]
        materials.append(next((file.materials[part] for part in known if part in file.materials), []))
        if not materials[-1] and name.lower() not in NO_MATERIAL:
            undefined.append(name)
        if len(materials[-1]) > 1:
            several.append(name)
    if undefined and (file.materials or not LIBRARY.search(file.content)):  # a library that is not read is listed by itself
        file.unread.append(f"materials that no library defines are not read: {_list_names(undefined)}")
    if several:
        file.unread.append(f"materials with several definitions have the last one: {_list_names(several)}")
    return materials


def _list_names(names: Sequence[str]) -> str:
    listed = ", ".join(islice(names, 5))
    return f"{listed} and {len(names) - 5} more" if len(names) > 5 else listed

"""OFF files of Geomview and its successors: polygons, with colours of vertices or of faces."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import GREY, build_part, check_mesh, cut_polygons, eight_bits, read_numbers
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh

KIND = re.compile(rb"\s*((?:ST|C|N|4|n)*)OFF\b|\s*off\b|\s*((?:ST|C|N|4|n)*)OFF(?=\d)")
"""The first word: which numbers follow the position of a vertex. Some files have no blank behind it; it may be missing."""
MAX_NORMAL = 2 * np.pi  # largest part of a normal that programs write: they sum up the angles of the faces at a vertex


def read_off(file: Companions, _: Textures) -> list[Mesh]:
    """Read the faces of an OFF file."""
    text, unread = re.sub(rb"#[^\r\n]*", b"", file.content), file.unread
    kind = KIND.match(text)
    columns = (kind[1] or kind[2] or b"").decode() if kind else ""
    lines = [line for line in (text[kind.end() :] if kind else text).splitlines() if line.strip()]
    if "n" in columns or (lines and lines[0].split()[0] == b"BINARY"):
        raise InvalidInput("it is an OFF of many dimensions or a binary one, which cannot be read; write it as text in three dimensions")
    counts = read_numbers(lines[0]) if lines else np.empty(0)
    if len(counts) < 2 or not ((counts >= 0) & (counts == np.rint(counts))).all():
        raise InvalidInput("it does not begin with OFF and the numbers of its vertices and faces")
    vertex_count, face_count = int(counts[0]), int(counts[1])
    if (rows := len(lines) - 1) < vertex_count + face_count:
        raise InvalidInput(f"{vertex_count} vertices and {face_count} faces take as many lines, and {rows} follow; is it cut off?")
    if rest := rows - vertex_count - face_count:
        unread.append(f"{rest} lines after the last of {face_count} faces are ignored")
    check_mesh(face_count, vertex_count)
    vertices, colors = _vertices(lines[1 : 1 + vertex_count], columns, unread)
    corners, sizes, face_colors = _faces(lines[1 + vertex_count : 1 + vertex_count + face_count], unread)
    triangles, polygon = cut_polygons(corners, sizes, vertices, unread)
    if colors is not None and face_colors is not None:
        unread.append("colours of faces are not read beside those of vertices")
        face_colors = None
    face_color = None if face_colors is None else face_colors[polygon]
    return [build_part(vertices, corners[triangles], face_color=face_color, vertex_color=colors)]


def _vertices(lines: Sequence[bytes], kind: str, unread: list[str]) -> tuple[Array, NDArray[np.uint8] | None]:
    """Read positions (V, 3) and colours (V, 4) from lines of position, normal, colour and texture coordinates."""
    numbers = read_numbers(b" ".join(lines))
    width = len(numbers) // max(len(lines), 1)
    position, normal, uv = 3 + ("4" in kind), 3 * ("N" in kind), 2 * ("ST" in kind)
    if lines and (width < position or {len(line.split()) for line in lines} != {width}):
        raise InvalidInput(f"the lines of its {len(lines)} vertices do not have equally many numbers, at least {position}; it is damaged")
    table = numbers.reshape(len(lines), width)
    vertices = table[:, :3] / table[:, 3:4] if position == 4 else table[:, :3]
    color = table[:, position + normal : width - uv]
    before, behind = table[:, position : width - uv - 3], table[:, width - uv - 3 : width - uv]
    if normal and color.shape[1] in (3, 4) and _are_colors(before, behind):
        color = before
    if uv:
        unread.append("texture coordinates of the OFF are not read; the format names no texture")
    if color.shape[1] in (3, 4) and "C" in kind:
        return vertices, eight_bits(color, fractions=True)
    if color.shape[1] or "C" in kind:
        unread.append(f"numbers at the end of each vertex are not read ({color.shape[1]}); a colour is three or four after the word COFF")
    return vertices, None


def _are_colors(first: Array, last: Array) -> bool:
    """Check whether colours stand before normals, as MeshLab writes them, and not behind, as Geomview defines and MeshLab reads them."""
    return bool(first.size and first.min() >= 0 and first.max() > MAX_NORMAL >= np.abs(last).max())


def _faces(lines: Sequence[bytes], unread: list[str]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8] | None]:
    """Read corners (C,), sizes (P,) and colours (P, 4) of faces from lines of a size, corners and perhaps a colour."""
    numbers = read_numbers(b" ".join(lines))
    widths = np.array([len(line.split()) for line in lines], np.int64)
    firsts = np.cumsum(widths) - widths
    sizes = numbers[firsts].astype(np.int64)
    further = widths - 1 - sizes
    if (further < 0).any() or (sizes < 0).any():
        raise InvalidInput(f"the line of face {int(np.argmax((further < 0) | (sizes < 0)))} has fewer corners than it says; it is damaged")
    corners = numbers[np.repeat(firsts + 1 - (np.cumsum(sizes) - sizes), sizes) + np.arange(sizes.sum())].astype(np.int64)
    if odd := np.count_nonzero(~np.isin(further, (0, 3, 4))):
        unread.append(f"colours of faces are not read ({odd} of {len(lines)}); a colour is three or four numbers")
    colored = np.isin(further, (3, 4))
    if not colored.any():
        return corners, sizes, None
    levels = np.zeros((len(lines), 4))
    for channel in range(4):
        has = colored & (further > channel)
        levels[has, channel] = numbers[(firsts + 1 + sizes + channel)[has]]
    colors = np.tile(np.array(GREY, np.uint8), (len(lines), 1))
    colors[colored] = eight_bits(levels[colored], fractions=True)
    colors[further == 3, 3] = 255
    return corners, sizes, colors

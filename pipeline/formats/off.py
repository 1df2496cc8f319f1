"""OFF files of Geomview and its successors: polygons."""

import re

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import build_part, check_mesh, cut_polygons, line_widths, read_columns, read_numbers
from pipeline.formats.textures import Textures
from pipeline.kernels.geometry.mesh import Mesh

KIND = re.compile(rb"\s*((?:ST|C|N|4|n)*)OFF\b|\s*off\b|\s*((?:ST|C|N|4|n)*)OFF(?=\d)")
"""The first word: which numbers follow the position of a vertex. Some files have no blank behind it; it may be missing."""


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

    width = 3 + ("4" in columns)
    table = read_columns(lines[1 : 1 + vertex_count], width + 3 * ("N" in columns) + 1)  # and one more, if there is one
    if np.isnan(table[:, :width]).any():
        raise InvalidInput(f"a line of its {vertex_count} vertices does not have {width} numbers; it is damaged")
    vertices = table[:, :3] / table[:, 3:4] if width == 4 else table[:, :3]
    if not np.isnan(table[:, -1]).all():
        unread.append("colours and texture coordinates of the vertices of the OFF are not read; write it as PLY")

    polygons = lines[1 + vertex_count : 1 + vertex_count + face_count]
    numbers, widths = read_numbers(b" ".join(polygons)), line_widths(polygons)
    firsts = np.cumsum(widths) - widths
    sizes = numbers[firsts].astype(np.int64)
    if (wrong := (sizes > widths - 1) | (sizes < 0)).any():
        raise InvalidInput(f"the line of face {int(np.argmax(wrong))} has fewer corners than it says; it is damaged")
    if colored := np.count_nonzero(widths - 1 > sizes):
        unread.append(f"colours of faces of the OFF are not read ({colored} of {face_count}); write it as PLY")
    corners = numbers[np.repeat(firsts + 1 - (np.cumsum(sizes) - sizes), sizes) + np.arange(sizes.sum())].astype(np.int64)
    return [build_part(vertices, corners[cut_polygons(corners, sizes, vertices, unread)[0]])]

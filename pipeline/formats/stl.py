"""STL files, binary and text."""

import re

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import MAX_FACES, build_part, check_count, read_numbers
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Floats
from pipeline.kernels.geometry.mesh import Mesh

HEAD = 84  # bytes before the first triangle of a binary file: 80 of a title, four of the number of triangles
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
NAME = re.compile(rb"(?:^|[\r\n])[ \t]*(?:end[ \t]*)?solid\b(?:(?!\bfacet\b)[^\r\n])*", re.IGNORECASE)
"""The begin or the end of a solid with its name, which may be any words."""
VERTEX = re.compile(rb"\bvertex((?:\s+[-+.\d]\S*)*)", re.IGNORECASE)
SOLID = re.compile(rb"\s*solid\b", re.IGNORECASE)
"""How text begins. A binary file may too, but has a zero byte in the number of its triangles."""
MESHLAB = b"COLOR=\x7f\x7f\x7f MATERIAL="  # how the title begins that MeshLab writes, also without colours


def read_stl(file: Companions, _: Textures) -> list[Mesh]:
    """Read the triangles of an STL file."""
    is_text = SOLID.match(file.content) and b"\0" not in file.content[:HEAD]
    corners = _read_text(file.content) if is_text else _read_binary(file.content, file.unread)
    vertices = corners.reshape(-1, 3).astype(np.float64)
    return [build_part(vertices, np.arange(len(vertices)).reshape(-1, 3))]


def _read_binary(content: bytes, unread: list[str]) -> Floats:
    """Read the corners (T, 3, 3) of triangles."""
    count = int.from_bytes(content[80:HEAD], "little")
    whole = HEAD + count * TRIANGLE.itemsize
    if len(content) < max(whole, HEAD):
        raise InvalidInput(f"{count} triangles take {max(whole, HEAD)} bytes, it has {len(content)}; it is cut off, or not an STL")
    check_count("faces", count, MAX_FACES, "decimate the mesh")
    if rest := content[whole:]:
        triangles, odd = divmod(len(rest), TRIANGLE.itemsize)
        if not odd and any(rest):
            raise InvalidInput(f"its header says {count} triangles, and {triangles} more follow; write it again with another program")
        unread.append(f"{len(rest)} bytes after the last of {count} triangles are ignored")
    records = np.frombuffer(content, TRIANGLE, count, HEAD)
    words = records["attribute"]
    if words.any() and not (content.startswith(MESHLAB) and (words == words[0]).all()):
        unread.append("colours of the STL (attributes of its triangles) are not read; write it as PLY")
    return np.asarray(records["corners"])


def _read_text(content: bytes) -> Floats:
    """Read the corners (T, 3, 3) of triangles."""
    text = NAME.sub(b"", content)
    vertices = VERTEX.findall(text)
    check_count("vertices", len(vertices), 3 * MAX_FACES, "decimate the mesh")
    numbers, loops = read_numbers(b" ".join(vertices)), len(re.findall(rb"\bendloop\b", text, re.IGNORECASE))
    if len(numbers) != 3 * len(vertices) or len(vertices) % 3 or (loops and len(vertices) != 3 * loops):
        raise InvalidInput(f"{len(numbers)} numbers in {len(vertices)} vertices in {loops} facets are no triangles; it is damaged")
    if not re.search(rb"\bend[ \t]*solid\b", content[-HEAD * TRIANGLE.itemsize :], re.IGNORECASE):
        raise InvalidInput(f"it ends after {loops} facets without the word endsolid; it is cut off")
    return numbers.reshape(-1, 3, 3)

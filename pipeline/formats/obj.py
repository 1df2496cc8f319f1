"""OBJ files and their materials: what trimesh reads wrongly, or does not read.

It cuts concave polygons into fans, counts relative numbers from the file's end, and skips lines that begin with a blank and materials
with a comment behind their name.
"""

import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import decode_text, foreign_content, without_mark
from pipeline.formats.mesh_parts import ear_clip, is_concave
from pipeline.kernels.arrays import Array, Integers

UNUSUAL = re.compile(rb"^(?:[ \t]+\S|(?:v[tn]?|f)(?:\t|[^#\r\n]*#))", re.MULTILINE)
"""A line that begins with a blank, a vertex or a face with a tab after its letter or a comment behind it."""
INDENT = re.compile(rb"^[ \t]+", re.MULTILINE)
GEOMETRY = re.compile(rb"^(v[tn]?|f)[ \t]+([^#\r\n]*)(?:#[^\r\n]*)?", re.MULTILINE)
VERTEX = re.compile(rb"^v +(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)
FACE = re.compile(rb"^f((?:[ \t]+-?\d+(?:/-?\d*){0,2}){3,})[ \t]*\r?$", re.MULTILINE)
MISREAD = re.compile(rb"^f(?:(?:[ \t]+[\d/-]+){4}|[ \t\d/]*-)", re.MULTILINE)
"""A face of more than three corners, or with relative numbers."""
USE = re.compile(rb"^usemtl[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
LIBRARY = re.compile(rb"(?:^|\r)[ \t]*mtllib[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
"""A line that names material libraries."""
DEFINITION = re.compile(rb"^[ \t]*newmtl[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
WRONG = re.compile(rb"^(?:[ \t]*(surf|bzp|bsp|cdp|fo)[ \t]|f[ \t](?:[^\r\n]*[ \t])?0+(?![.\d]))", re.MULTILINE)
"""A surface that is no polygon, a statement of the first version of the format, or a face that names vertex 0."""
NO_MATERIAL = (b"", b"none", b"(null)", b"null", b"default")  # names that programs write where faces have no material
OPTIONS = re.compile(r"(-[a-zA-Z_]+\s+((on|off|[lmrgbz]|-?[\d.]+)\s+)*)+(?=\S)")
"""What may stand before the name of a texture, as `-s 1 1 1`."""
MOVED = re.compile(r"-[sot](\s+-?\.?\d[\d.]*)+")  # options that scale, move or disturb texture coordinates
STILL = re.compile(r"-s(\s+1(\.0*)?)+|-[ot](\s+-?\.?0[0.]*)+")  # those that leave them as they are
CLAMP = re.compile(r"-clamp\s+on\b")
Values = Mapping[str, Any]
"""The entries of a material by their names in lower case, as trimesh keeps them: lists of words, or numbers of colours."""


def usual_text(content: bytes) -> bytes:
    """Write an OBJ file in UTF-8, with line feeds where it has carriage returns alone, as its readers need it."""
    text = content if content.isascii() else decode_text(content).encode()
    return text if b"\n" in text else text.replace(b"\r", b"\n")


def check_statements(content: bytes, unread: list[str]) -> None:
    """Refuse an OBJ file with surfaces that are no polygons or with vertices 0, and note colours that are not read."""
    if (wrong := WRONG.search(content)) and wrong[1]:
        raise InvalidInput(f"it has free-form or outdated surfaces ({wrong[1].decode()}), which cannot be read; export it as polygons")
    if wrong:
        raise InvalidInput("a face names vertex 0, the first one is 1; write it again with another program")
    if b"\n#MRGB " in content:  # as ZBrush writes them
        unread.append("colours of vertices in comments (#MRGB) are not read")


def rewrite_lines(content: bytes) -> bytes:
    """Write an OBJ file's concave polygons as triangles between the same corners, relative numbers as absolute ones, lines without indent.

    Faces that cannot be understood, or have no area, stay as they are.
    """
    text = content.replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")  # lines that continue
    if UNUSUAL.search(text):
        content = text = GEOMETRY.sub(rb"\1 \2", INDENT.sub(b"", text))
    if MISREAD.search(text) is None:
        return content
    try:
        vertices = np.array([match.groups() for match in VERTEX.finditer(text)]).astype(np.float64).reshape(-1, 3)
    except ValueError:  # its reader says what is wrong
        return content
    faces = list(FACE.finditer(text))
    triangles = _cut_concave(faces, _offsets(b"v", text), vertices)
    relative = [number for number, face in enumerate(faces) if b"-" in face[1]]
    listed = [_offsets(kind, text) for kind in (b"v", b"vt", b"vn")] if relative else []
    pieces, end = list[bytes](), 0
    for number in sorted({*triangles, *relative}):
        face = faces[number]
        corners = [_absolute(corner, face.start(), listed) if relative else corner for corner in face[1].split()]
        parts = [[corners[index] for index in triangle] for triangle in triangles.get(number, [range(len(corners))])]
        pieces += [text[end : face.start()], b"\n".join(b"f " + b" ".join(part) for part in parts)]
        end = face.end()
    return b"".join([*pieces, text[end:]]) if pieces else content


def _offsets(kind: bytes, text: bytes) -> NDArray[np.int64]:
    return np.array([match.start() for match in re.finditer(rb"^" + kind + b" ", text, re.MULTILINE)], np.int64)


def _absolute(corner: bytes, offset: int, listed: Sequence[NDArray[np.int64]]) -> bytes:
    """Write a corner of a face at this offset with absolute numbers of vertex, texture coordinate and normal."""
    parts = [
        b"%d" % (np.searchsorted(offsets, offset) + 1 + int(part)) if part[:1] == b"-" else part
        for part, offsets in zip(corner.split(b"/"), listed, strict=False)  # the latter two may be missing
    ]
    if int(parts[0]) < 1:
        raise InvalidInput(f"a face has relative index {corner.decode().partition('/')[0]}, before the first vertex; the file is damaged")
    return b"/".join(parts)


def _cut_concave(faces: Sequence[re.Match[bytes]], offsets: NDArray[np.int64], vertices: Array) -> dict[int, Integers]:
    """Cut the concave ones of some faces into triangles (T, 3) of their corners, by the number of the face."""
    listed = np.fromstring(re.sub(rb"/\S*", b"", b" ".join(face[1] for face in faces)), np.int64, sep=" ")
    sizes = np.array([len(face[1].split()) for face in faces], np.int64)
    before = np.searchsorted(offsets, np.array([face.start() for face in faces], np.int64))
    named = np.where(listed < 0, listed + np.repeat(before, sizes), listed - 1)
    firsts, triangles = np.cumsum(sizes) - sizes, {}
    for size in np.unique(sizes[sizes > 3]):
        numbers = np.flatnonzero(sizes == size)
        indices = named[firsts[numbers, None] + np.arange(size)]
        known = ((indices >= 0) & (indices < len(vertices))).all(axis=1)
        corners = vertices[indices[known]]  # (faces, size, 3)
        for row in np.flatnonzero(is_concave(corners)):
            cut = ear_clip(corners[row])
            if len(cut) == size - 2:
                triangles[int(numbers[known][row])] = cut
    return triangles


def rewrite_uses(
    content: bytes,
    libraries: bytes,  # content of the material libraries
    unread: list[str],
) -> bytes:
    """Write the names of materials as their libraries do, without comments behind them and in the same case; list unknown ones."""
    definitions = defaultdict[bytes, set[bytes]](set)
    pieces = DEFINITION.split(libraries)
    for name, definition in zip(pieces[1::2], pieces[2::2], strict=True):
        definitions[_name(name)].add(b" ".join(definition.split()))
    folded = {name.lower(): name for name in definitions}
    undefined, several = dict[bytes, None](), dict[bytes, None]()  # each once, in order

    def named(use: re.Match[bytes]) -> bytes:
        stated = _name(use[1])
        candidates = (stated, _name(stated.partition(b"#")[0]))  # a name may contain it
        name = next((name for name in candidates if name in definitions), None)
        name = name or next((folded[name.lower()] for name in candidates if name.lower() in folded), stated)
        if name not in definitions and name.lower() not in NO_MATERIAL:
            undefined[name] = None
        if len(definitions.get(name, ())) > 1:
            several[name] = None
        return b"usemtl " + name

    content = USE.sub(named, content)
    if undefined and (definitions or not LIBRARY.search(content)):  # a library that is not read is listed by itself
        unread.append(f"materials that no library defines are not read: {_list_names(undefined)}")
    if several:
        unread.append(f"materials with several definitions have the last one: {_list_names(several)}")
    return content


def _name(text: bytes) -> bytes:
    return b" ".join(text.split())


def _list_names(names: Collection[bytes]) -> str:
    listed = ", ".join(name.decode("utf-8", "replace") for name in islice(names, 5))
    return f"{listed} and {len(names) - 5} more" if len(names) > 5 else listed


def read_library(name: str, content: bytes, unread: list[str]) -> bytes:
    """Return the statements of a material library that trimesh reads: one that it cannot read would cost all materials."""
    try:
        text = decode_text(without_mark(name, content))
    except InvalidInput as error:
        unread.append(str(error))
        return b""
    lines = [line for raw in text.splitlines() if (line := raw.strip()) and not line.startswith("#")]
    if not content or "\0" in text or (lines and not any(line.lower().startswith("newmtl") for line in lines)):
        unread.append(f"{name} is {foreign_content(content) or 'not a material library'}")
        return b""
    kept, material = list[str](), ""
    for line in lines:
        key, *words = line.split()
        match key.lower():
            case "newmtl":
                material = " ".join(words)
                kept.append(line)
            case "kd" | "ke" | "d" | "tr":
                count, values = (3 if key[0] in "kK" else 1), _finite_numbers(words)
                if len(values) in (1, count):
                    kept.append(" ".join([key, *map(repr, values * (count // len(values)))]))
                else:
                    unread.append(f"{line} of material {material} in {name} is not read")
            case "map_kd" | "map_ka" | "map_ke" | "map_d":
                kept.append(line)
    return "\n".join(kept).encode()


def _finite_numbers(words: Sequence[str]) -> list[float]:
    """Read the finite numbers of a statement, up to a comment and without `-halo`; none if another word is among them."""
    ended = next((number for number, word in enumerate(words) if word.startswith("#")), len(words))
    try:
        numbers = [float(word) for word in words[:ended] if word != "-halo"]
    except ValueError:
        return []
    return numbers[:3] if np.isfinite(numbers).all() else []


def opacity(values: Values) -> float:
    """Read the opacity of a material, 0 to 1: `d`, else 1 - `Tr`, where 1 is opaque too, as early versions of MeshLab write it."""
    transparency = float(values["tr"][0]) if "tr" in values else 0.0
    stated = float(values["d"][0]) if "d" in values else 1 - transparency if transparency < 1 else 1.0
    return float(np.clip(stated, 0, 1))


def keeps_alpha(values: Values, texture: str) -> bool:
    """Check whether the alpha of a texture is an opacity: `map_d` names the same file."""
    return "map_d" in values and _file(" ".join(values["map_d"])) == _file(texture)


def emission(values: Values) -> Array | None:
    """Read the colour that a material emits, (3,) in 0 to 1, if it has no other one."""
    light = np.clip(np.array(values.get("ke", [0.0]), np.float64), 0, 1)
    return light if light.any() and not np.any(values.get("kd", 0.0)) else None


def losses(material: Any, uv: np.ndarray | None) -> Iterator[str]:
    """Name what is not read of one of trimesh's materials of an OBJ, with texture coordinates (V, 2)."""
    values = getattr(material, "kwargs", {})
    image = getattr(material, "image", None)
    texture = None if image is None else str(image.info.get("file_path", ""))
    if texture is None:
        yield from (f"{word} of material {material.name} is not read" for word in ("map_Ka", "map_Ke") if word.lower() in values)
    if texture and uv is not None and CLAMP.search(texture) and (np.abs(np.asarray(uv) - 0.5) > 0.5 + 1e-6).any():
        yield f"{_file(texture)} is clamped (-clamp on), and repeats here where coordinates are outside 0 to 1"
    if texture and (moved := [option[0] for option in MOVED.finditer(texture) if not STILL.fullmatch(option[0])]):
        yield f"{' '.join(moved)} of {_file(texture)} is not applied"
    if "map_d" in values and not (texture and keeps_alpha(values, texture)):
        yield f"map_d {_file(' '.join(values['map_d']))} of material {material.name} is not read"


def _file(text: str) -> str:
    return text[match.end() :] if (match := OPTIONS.match(text)) else text

"""glTF 2.0 documents, text or binary: their JSON, the files that it names, and the arrays of accessors and primitives."""

import base64
import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import refuse_foreign
from pipeline.formats.mesh_parts import strip_corners
from pipeline.kernels.arrays import Array

MAX_ENTRIES = 1_000_000  # maximum number of commas and opening brackets in the JSON: each may take a hundred bytes
MAX_ROWS = 6_000_000  # maximum number of rows of an accessor: the corners of two million triangles
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""The types of an accessor's components (glTF 2.0, section 3.6.2.2)."""
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}  # the numbers of components of the types of accessors that a mesh uses
TRIANGLES, STRIP, _ = SURFACES = (4, 5, 6)  # modes of primitives that are surfaces; others are points and lines
COMPRESSION = re.compile("compress", re.IGNORECASE)  # extensions that encode arrays; each array or primitive says whether it is encoded
SAME_SHAPE = re.compile(
    "KHR_mesh_quantization|EXT_mesh_gpu_instancing|KHR_node_visibility|material|texture|light|metadata|features|xmp|anim|MSFT_lod",
    re.IGNORECASE,
)
"""Extensions that are read, or that leave the shape as it is; what materials and textures lose is said where it is lost."""


def read_document(name: str, content: bytes) -> dict[str, Any]:
    """Read the JSON of a glTF file, text or binary (glTF 2.0, sections 3.3 and 4.4), and refuse one that cannot be read in full."""
    if content.startswith(b"glTF"):
        if (version := int.from_bytes(content[4:8], "little")) != 2:
            raise InvalidInput(f"{name} is binary glTF of version {version}; convert it to glTF 2.0")
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")].rstrip(b"\0")
    if (entries := sum(content.count(mark) for mark in (b",", b"[", b"{"))) > MAX_ENTRIES:
        raise InvalidInput(f"{name} has {entries} entries in its JSON, {MAX_ENTRIES} are the most; join its nodes and meshes")
    try:
        tree: Any = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{name} cannot be read as {name.rpartition('.')[2].upper()}: {error}") from error
    if not isinstance(tree, dict):
        raise InvalidInput(f"{name} cannot be read as {name.rpartition('.')[2].upper()}: its JSON is not an object")
    if (stated := str(table(tree, "asset").get("version", "2.0"))).startswith("1"):
        raise InvalidInput(f"{name} is glTF {stated}; convert it to glTF 2.0")
    if required := foreign_extensions(tree, "extensionsRequired"):
        raise InvalidInput(f"{name} requires {required[0]}, which cannot be read; export it without extensions")
    return tree


def foreign_extensions(tree: Mapping[str, Any], kind: str) -> list[str]:
    """List the extensions of a document that may change the shape, and are not read."""
    names = map(one_line, list_of(tree, kind))
    return [name for name in names if not SAME_SHAPE.search(name) and not COMPRESSION.search(name)]


def file_names(tree: Mapping[str, Any]) -> Iterator[str]:
    """List the URIs of a document's buffers and images that name files."""
    uris = (part.get("uri") for kind in ("buffers", "images") for part in list_of(tree, kind) if isinstance(part, dict))
    return (uri for uri in uris if isinstance(uri, str) and not uri.startswith("data:"))


def one_line(text: object) -> str:
    """Return a name or a number in the JSON as one short line, for messages."""
    return " ".join(str(text).split())[:80]


def table(part: Any, name: str) -> dict[str, Any]:
    """Return an object in an object of the JSON, empty where there is none."""
    value = part.get(name) if isinstance(part, dict) else None
    return value if isinstance(value, dict) else {}


def list_of(part: Mapping[str, Any], name: str) -> list[Any]:
    """Return a list in an object of the JSON, empty where there is none."""
    value = part.get(name)
    return value if isinstance(value, list) else []


def compression(part: Mapping[str, Any]) -> str | None:
    """Name the extension by which a primitive or a buffer view is compressed; None where it is not."""
    extension = next(filter(COMPRESSION.search, table(part, "extensions")), None)
    return f"Draco ({extension})" if extension and "draco" in extension else extension


def whole(part: Mapping[str, Any], name: str, default: int | None = None) -> int:
    """Return a number in an object of the JSON that is a size or a position."""
    value = part.get(name, default)
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value < 2**53 or value != int(value):
        raise InvalidInput(f"its JSON has {name} {one_line(value)}, not a size; export it again")
    return int(value)


class Document:
    """A glTF file; `read` returns the content of a file that it names, by its URI, or None where that is missing."""

    def __init__(self, name: str, content: bytes, read: Callable[[str], bytes | None]) -> None:
        self.tree = read_document(name, content)
        self._read = read
        start = 20 + int.from_bytes(content[12:16], "little")  # of the second chunk of a binary file
        self._binary = content[start + 8 :] if content.startswith(b"glTF") and content[start + 4 : start + 8] == b"BIN\0" else b""
        self._contents: dict[int, bytes] = {}

    def entry(self, kind: str, number: Any) -> dict[str, Any]:
        """Return an entry of a list of the document, such as `"meshes"`, by its number."""
        entries = list_of(self.tree, kind)
        entry = entries[number] if type(number) is int and 0 <= number < len(entries) else None
        if not isinstance(entry, dict):
            raise InvalidInput(f"its JSON names number {one_line(number)} of {len(entries)} {kind}; export it again")
        return entry

    def array(self, number: Any, *widths: int, rows: int | None = None) -> NDArray[Any]:
        """Read an accessor of one of these widths, and of this number of rows if there is one: (rows, width) as it is stored, or float64
        where it holds normalised integers.
        """
        accessor = self.entry("accessors", number)
        count, dtype = whole(accessor, "count"), COMPONENTS.get(accessor.get("componentType", 0))
        width = WIDTHS.get(accessor.get("type", ""), 0)
        if dtype is None or width not in widths:
            raise InvalidInput(f"accessor {number} is {accessor.get('type')} of {accessor.get('componentType')}; export it again")
        if count > MAX_ROWS or rows not in (None, count):
            raise InvalidInput(f"accessor {number} has {count} rows, not {rows or f'at most {MAX_ROWS}'}; export it again")
        values = self._rows(accessor, count, width, dtype) if "bufferView" in accessor else np.zeros((count, width), dtype)
        if sparse := table(accessor, "sparse"):
            changed, of = whole(sparse, "count"), table(sparse, "indices")
            indices = self._rows(of, changed, 1, COMPONENTS[of["componentType"]])[:, 0]
            if changed > count or indices.dtype.kind != "u" or (changed and indices.max() >= count):
                raise InvalidInput(f"accessor {number} of {count} rows has {changed} sparse ones outside it; export it again")
            values = values.copy()
            values[indices] = self._rows(table(sparse, "values"), changed, width, dtype)
        if accessor.get("normalized") and values.dtype.kind != "f":
            return np.maximum(values / np.iinfo(values.dtype).max, -1)
        return values

    def view(self, number: Any) -> memoryview:
        """Return the bytes of a buffer view."""
        view = self.entry("bufferViews", number)
        start, size = whole(view, "byteOffset", 0), whole(view, "byteLength")
        content = self._content(view.get("buffer"))
        if (encoded := compression(view)) and (start + size > len(content) or not np.frombuffer(content, np.uint8).any()):
            raise InvalidInput(f"it is compressed with {encoded}, which cannot be read; export it without compression")
        if start + size > len(content):
            name = one_line(self.entry("buffers", view["buffer"]).get("uri", "its buffer"))
            raise InvalidInput(f"{name} is missing or cut off: {start + size} bytes are needed, there are {len(content)}")
        return memoryview(content)[start : start + size]

    def image(self, number: Any) -> tuple[str, bytes | None]:
        """Return the name of an image, and its content if it is there."""
        image = self.entry("images", number)
        uri, name = image.get("uri"), one_line(image.get("name") or f"image {number}")
        if uri is None:
            return name, bytes(self.view(image.get("bufferView")))
        return name if uri.startswith("data:") else one_line(uri), self._resource(uri)

    def _rows(self, part: Mapping[str, Any], count: int, width: int, dtype: str) -> NDArray[Any]:
        """View (count, width) components in the buffer view that an accessor or a part of it names."""
        content = self.view(part.get("bufferView"))
        start, size = whole(part, "byteOffset", 0), width * np.dtype(dtype).itemsize
        stride = whole(self.entry("bufferViews", part["bufferView"]), "byteStride", 0) or size
        if count and start + stride * (count - 1) + size > len(content):
            raise InvalidInput(f"buffer view {part['bufferView']} has {len(content)} bytes, too few for {count} rows; is the file cut off?")
        return np.ndarray((count, width), dtype, content, start if count else 0, (stride, size // width))

    def _content(self, number: Any) -> bytes:
        """Return the content of a buffer, empty where there is none: the first of a binary file is the file's second chunk."""
        buffer = self.entry("buffers", number)
        if number not in self._contents:
            uri = buffer.get("uri")
            inside = self._binary if number == 0 and not compression(buffer) else b""
            self._contents[number] = content = inside if uri is None else self._resource(str(uri)) or b""
            if uri is not None and content and content[:4].isascii():  # numbers may begin like a compressed file
                refuse_foreign(one_line(uri), content)
        return self._contents[number]

    def _resource(self, uri: str) -> bytes | None:
        """Return what a URI holds or names; None where it names a file that is missing."""
        if not uri.startswith("data:"):
            return self._read(uri)
        head, _, data = uri.partition(",")
        return base64.b64decode(data) if head.endswith(";base64") else unquote_to_bytes(data)


class GltfPrimitive:
    """A part of a mesh with one material: its `faces` (F, 3), and the vertices that they name, which are `rows` (V,) of its attributes.

    `part` is its entry in the document, `weights` (T,) are those of its morph targets.
    """

    def __init__(self, document: Document, part: dict[str, Any], weights: Array) -> None:
        self._document, self._weights = document, weights
        self.material = part.get("material")
        self.attributes, self._targets = table(part, "attributes"), list_of(part, "targets")
        positions = document.array(self.attributes.get("POSITION"), 3)
        numbers = [self.attributes["POSITION"], *([part["indices"]] if "indices" in part else [])]
        encoded = compression(part)
        if encoded:
            numbers += self.attributes.values()
        stored = all({"bufferView", "sparse"} & document.entry("accessors", number).keys() for number in numbers)
        if not stored or (encoded and not np.ptp(positions, axis=0).any()):
            raise InvalidInput(f"it is compressed with {encoded or 'an extension'}, which cannot be read; export it without compression")
        self._size = len(positions)
        corners = self._corners(part)
        used = np.zeros(self._size, bool)
        used[corners] = True
        self.rows, self.faces = np.flatnonzero(used), (np.cumsum(used) - 1)[corners]

    def stored(self, name: str, *widths: int) -> NDArray[Any]:
        """Return the rows of an attribute that faces use, (V, width)."""
        if name not in self.attributes:
            raise InvalidInput(f"a part of it has no {name}; export it again")
        return self._document.array(self.attributes.get(name), *widths, rows=self._size)[self.rows]

    def read(self, name: str, *widths: int) -> Array:
        """Return an attribute of the vertices, (V, width), with its morph targets."""
        values = self.stored(name, *widths).astype(np.float64)
        for weight, target in zip(self._weights, self._targets, strict=False):
            if weight and name in target:
                values += weight * self._document.array(target[name], values.shape[1], rows=self._size)[self.rows]
        return values

    def _corners(self, part: dict[str, Any]) -> NDArray[np.int64]:
        """List the triangles, (F, 3) rows of the attributes, of a list, a strip or a fan."""
        corners: NDArray[Any] = np.arange(self._size)
        if "indices" in part:
            corners = self._document.array(part["indices"], 1)[:, 0]
            if corners.dtype.kind != "u" or corners.max(initial=0) >= max(self._size, 1):
                raise InvalidInput(f"a face names a vertex outside 0..{self._size - 1}; export it again")
            corners = corners.astype(np.int64)
        if (mode := part.get("mode", TRIANGLES)) == TRIANGLES:
            if len(corners) % 3:
                raise InvalidInput(f"a list of triangles has {len(corners)} corners, not three per face; export it again")
            return corners.reshape(-1, 3)
        faces = corners[strip_corners(len(corners), fan=mode != STRIP)]
        with_area = (faces != np.roll(faces, 1, axis=1)).all(axis=1)  # strips are joined by faces without
        return np.asarray(faces[with_area])

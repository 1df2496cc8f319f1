"""The elements of a PLY file as arrays: text or binary of either byte order, with lists of any lengths."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import decode_text
from pipeline.formats.mesh_parts import MAX_FACES, check_count, read_numbers

TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"},
    **{f"int{bits}": f"i{bits // 8}" for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": f"u{bits // 8}" for bits in (8, 16, 32, 64)},
    **{f"float{bits}": f"f{bits // 8}" for bits in (16, 32, 64)},
}
"""NumPy's types by their names in a PLY file, old and new."""
HEADER = re.compile(rb"\s*ply[ \t]*[\r\n].*?[\r\n]end_header[ \t]*(?:\r\n|\n|\r)", re.DOTALL)


@dataclass(frozen=True)
class Property:
    """A number, or a list of numbers, of each row of an element."""

    name: str
    type: np.dtype
    count_type: np.dtype | None = None  # of a list


@dataclass
class Element:
    """The rows of an element, as `values` by the name of a property; those of lists one after the other, `sizes` of each row."""

    name: str
    length: int
    properties: list[Property] = field(default_factory=list)
    values: dict[str, NDArray[Any]] = field(default_factory=dict)
    sizes: dict[str, NDArray[np.int64]] = field(default_factory=dict)

    def columns(self, *names: str) -> NDArray[Any] | None:
        """Return the numbers (N, names) of some properties; None if one is missing or a list."""
        if any(name not in self.values or name in self.sizes for name in names):
            return None
        return np.column_stack([self.values[name] for name in names])


class _Numbers:
    """The numbers of a text file, each at a position of its own, whatever its type."""

    unit = "numbers"

    def __init__(self, content: bytes) -> None:
        self._numbers = read_numbers(content)
        self.length = len(self._numbers)

    def size(self, _: np.dtype) -> int:
        return 1

    def read(self, positions: NDArray[np.int64], kind: np.dtype) -> NDArray[Any]:
        return self._numbers[positions].astype(kind if kind.kind == "f" else np.int64)


class _Bytes:
    """The numbers of a binary file, at any positions."""

    unit = "bytes"

    def __init__(self, content: bytes) -> None:
        self._content, self.length = content, len(content)

    def size(self, kind: np.dtype) -> int:
        return kind.itemsize

    def read(self, positions: NDArray[np.int64], kind: np.dtype) -> NDArray[Any]:
        count = max(self.length - kind.itemsize + 1, 0)
        return np.ndarray((count,), kind, self._content, strides=(1,))[positions].astype(kind.newbyteorder("="))


def read_elements(content: bytes, unread: list[str]) -> list[Element]:
    """Read the elements of a PLY file; append what follows the last element to `unread`."""
    if not (header := HEADER.match(content)):
        raise InvalidInput("it has no header that begins with ply and ends with end_header; it is cut off, or not a PLY")
    elements, order = _parse_header([decode_text(line) for line in header[0].splitlines()])
    source = _Bytes(content[header.end() :]) if order else _Numbers(content[header.end() :])
    start = 0
    for element in elements:
        check_count(f"rows of {element.name}", element.length, 3 * MAX_FACES, "decimate the mesh")
        start = _read_rows(element, source, start)
    if start < source.length:
        unread.append(f"{source.length - start} {source.unit} after the last row are ignored")
    return elements


def _parse_header(lines: Sequence[str]) -> tuple[list[Element], str]:
    """Parse the lines of a header: its elements, and the byte order, "" for text."""
    elements, order = list[Element](), ""
    for line in lines:
        match line.split():
            case ["format", kind, *_]:
                order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kind.lower()]
            case ["element", name, length]:
                elements.append(Element(name.lower(), int(length)))
                if elements[-1].length < 0:
                    raise InvalidInput(f"its element {name} has {length} rows; the file is damaged")
            case ["property", "list", count, kind, name]:
                elements[-1].properties.append(Property(name.lower(), np.dtype(order + TYPES[kind]), np.dtype(order + TYPES[count])))
            case ["property", kind, name]:
                elements[-1].properties.append(Property(name.lower(), np.dtype(order + TYPES[kind])))
    return elements, order


def _read_rows(element: Element, source: _Numbers | _Bytes, start: int) -> int:
    """Read the values of an element from a position; return the position after its last row."""
    lists = [of for of in element.properties if of.count_type is not None]
    sizes = _uniform_sizes(element, source, start)
    if sizes is None:
        sizes = _walk_sizes(element, source, start)
    widths = [
        np.int64(source.size(of.type))
        if of.count_type is None
        else source.size(of.count_type) + sizes[lists.index(of)] * source.size(of.type)
        for of in element.properties
    ]
    row_width = np.broadcast_to(np.asarray(sum(widths), np.int64), element.length)
    position = start + np.cumsum(row_width) - row_width
    if (end := start + int(row_width.sum())) > source.length:
        raise _cut_off(element, source)
    for of, width in zip(element.properties, widths, strict=True):
        if of.count_type is None:
            element.values[of.name] = source.read(position, of.type)
        else:
            size, step = sizes[lists.index(of)], source.size(of.type)
            first = position + source.size(of.count_type) - step * (np.cumsum(size) - size)
            element.values[of.name] = source.read(np.repeat(first, size) + step * np.arange(size.sum()), of.type)
            element.sizes[of.name] = size
        position = position + width
    return end


def _uniform_sizes(element: Element, source: _Numbers | _Bytes, start: int) -> list[NDArray[np.int64]] | None:
    """Read the sizes of the lists of an element if they are those of the first row throughout."""
    at, offsets = start, list[tuple[int, int, np.dtype]]()
    for of in element.properties:
        if of.count_type is None:
            at += source.size(of.type)
            continue
        if at + source.size(of.count_type) > source.length:
            return None
        size = int(source.read(np.array([at]), of.count_type)[0])
        offsets.append((at, size, of.count_type))
        at += source.size(of.count_type) + size * source.size(of.type)
    if (at - start) * element.length > source.length - start:
        return None
    rows = (at - start) * np.arange(element.length)
    if any(size < 0 or (source.read(offset + rows, kind) != size).any() for offset, size, kind in offsets):
        return None
    return [np.full(element.length, size, np.int64) for _, size, _ in offsets]


def _walk_sizes(element: Element, source: _Numbers | _Bytes, start: int) -> list[NDArray[np.int64]]:
    """Read the sizes of the lists of an element row by row."""
    sizes = [np.zeros(element.length, np.int64) for of in element.properties if of.count_type is not None]
    steps = [(source.size(of.type), of.count_type, of.count_type and source.size(of.count_type)) for of in element.properties]
    for row in range(element.length):
        number = 0
        for step, count_type, count_step in steps:
            if count_type is None or count_step is None:
                start += step
                continue
            if start + count_step > source.length:
                raise _cut_off(element, source)
            size = int(source.read(start, count_type))  # type: ignore[arg-type]  # one position
            if size < 0:
                raise InvalidInput(f"a list in row {row} of its element {element.name} has {size} entries; the file is damaged")
            sizes[number][row] = size
            number += 1
            start += count_step + size * step
    if start > source.length:
        raise _cut_off(element, source)
    return sizes


def _cut_off(element: Element, source: _Numbers | _Bytes) -> InvalidInput:
    return InvalidInput(
        f"its {element.length} rows of {element.name} need more than the {source.length} {source.unit} that follow; it is cut off"
    )

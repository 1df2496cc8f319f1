"""The elements of a PLY file as arrays: text or binary of either byte order, with lists of any lengths."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import decode_text
from pipeline.formats.mesh_parts import MAX_FACES, check_count, read_numbers

TYPES = {  # NumPy's types by their names in a PLY file, old and new
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"},
    **{f"int{bits}": f"i{bits // 8}" for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": f"u{bits // 8}" for bits in (8, 16, 32, 64)},
    **{f"float{bits}": f"f{bits // 8}" for bits in (16, 32, 64)},
}
HEADER = re.compile(rb"\s*ply[ \t]*[\r\n].*?[\r\n]end_header[ \t]*(?:\r\n|\n|\r)", re.DOTALL)


Sizes = Mapping[str, NDArray[np.int64]]  # the sizes (N,) of lists by the names of their properties


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


class _Source:
    """The numbers of a file: at any byte of a binary one; of text each at a position of its own, whatever its type."""

    def __init__(self, content: bytes, *, text: bool) -> None:
        self._content: NDArray[Any] = read_numbers(content) if text else np.frombuffer(content, np.uint8)
        self._text, self.length, self.unit = text, len(self._content), "numbers" if text else "bytes"

    def size(self, kind: np.dtype) -> int:
        return 1 if self._text else kind.itemsize

    def read(self, positions: NDArray[np.int64], kind: np.dtype) -> NDArray[Any]:
        if self._text:
            return self._content[positions].astype(kind if kind.kind == "f" else np.int64)
        count = max(self.length - kind.itemsize + 1, 0)
        return np.ndarray((count,), kind, self._content, strides=(1,))[positions].astype(kind.newbyteorder("="))


def read_elements(content: bytes, unread: list[str]) -> list[Element]:
    """Read the elements of a PLY file; append what follows the last element to `unread`."""
    if not (header := HEADER.match(content)):
        raise InvalidInput("it has no header that begins with ply and ends with end_header; it is cut off, or not a PLY")
    elements, order = _parse_header([decode_text(line) for line in header[0].splitlines()])
    source = _Source(content[header.end() :], text=not order)
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


def _read_rows(element: Element, source: _Source, start: int) -> int:
    """Read the values of an element from a position; return the position after its last row."""
    least = sum(source.size(of.count_type or of.type) for of in element.properties)
    if element.length * least > source.length - start:
        raise _cut_off(element, source)
    first = _list_sizes(element, source, start, min(element.length, 1))
    sizes = {name: np.full(element.length, size.sum()) for name, size in first.items()}  # as in the first row throughout, or not
    end = _end(element, source, start, sizes)
    positions = _positions(element, source, start, sizes)
    if end > source.length or any(
        of.count_type is not None and (source.read(at, of.count_type) != sizes[of.name]).any() for of, at in positions
    ):
        sizes = _list_sizes(element, source, start, element.length)
        end = _end(element, source, start, sizes)
    if end > source.length:
        raise _cut_off(element, source)
    for of, position in _positions(element, source, start, sizes):
        at = position
        if of.count_type is not None:
            size, step = sizes[of.name], source.size(of.type)
            first_entry = position + source.size(of.count_type) - step * (np.cumsum(size) - size)
            at = np.repeat(first_entry, size) + step * np.arange(size.sum())
        element.values[of.name] = source.read(at, of.type)
    element.sizes = sizes
    return end


def _widths(element: Element, source: _Source, sizes: Sizes) -> list[NDArray[np.int64]]:
    """Compute the width of each property, () or (N,) for lists, from the sizes of lists."""
    scalars = [np.asarray(source.size(of.count_type or of.type), np.int64) for of in element.properties]
    return [
        width + sizes[of.name] * source.size(of.type) if of.name in sizes else width
        for of, width in zip(element.properties, scalars, strict=True)
    ]


def _end(element: Element, source: _Source, start: int, sizes: Sizes) -> int:
    return start + sum(int(np.broadcast_to(width, element.length).sum()) for width in _widths(element, source, sizes))


def _positions(element: Element, source: _Source, start: int, sizes: Sizes) -> Iterator[tuple[Property, NDArray[np.int64]]]:
    """Yield where each property begins in each row, (N,)."""
    widths = _widths(element, source, sizes)
    row = np.broadcast_to(np.asarray(sum(widths), np.int64), element.length)
    position = start + np.cumsum(row) - row
    for of, width in zip(element.properties, widths, strict=True):
        yield of, position
        position = position + width


def _list_sizes(element: Element, source: _Source, start: int, rows: int) -> dict[str, NDArray[np.int64]]:
    """Read the sizes of the lists of an element's first rows, row by row."""
    sizes = {of.name: np.zeros(rows, np.int64) for of in element.properties if of.count_type is not None}
    steps = [(of.name, source.size(of.type), of.count_type) for of in element.properties]
    for row in range(rows):
        for name, step, count_type in steps:
            if count_type is None:
                start += step
                continue
            if start + source.size(count_type) > source.length:
                raise _cut_off(element, source)
            size = int(source.read(start, count_type))  # type: ignore[arg-type]  # one position
            if size < 0:
                raise InvalidInput(f"a list in row {row} of its element {element.name} has {size} entries; the file is damaged")
            sizes[name][row] = size
            start += source.size(count_type) + size * step
    return sizes


def _cut_off(element: Element, source: _Source) -> InvalidInput:
    return InvalidInput(f"its {element.length} rows of {element.name} need more than the {source.length} {source.unit} left; it is cut off")

"""Read the unit and the up-axis that a mesh file or its format's specification states."""

import re
from contextlib import suppress
from pathlib import Path

from pipeline.formats.file_content import without_mark
from pipeline.formats.threemf import PART_HEAD_BYTES, Package

COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
METRES = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}  # metres per unit, by its sign
LEAST_UNIT, GREATEST_UNIT = 1e-9, 1e9  # bounds of metres per unit: in others, sizes round to 0 or overflow
THREEMF = {b"micron": 1e-6, b"millimeter": 1e-3, b"centimeter": 1e-2, b"inch": 0.0254, b"foot": 0.3048, b"meter": 1.0}
"""Metres per unit, by its name in a 3MF file."""


def stated_units(file: Path) -> tuple[float | None, str | None]:
    """Read metres per unit and the up-axis, "x", "y" or "z", that a mesh file or its format states; None for what neither does.

    glTF 2.0, section 3.4: metres, y up. COLLADA 1.4: `<unit meter="...">` and `<up_axis>` of its asset; Y_UP where it states none. 3MF
    core, section 3.4: `<model unit="...">`, millimetres where it states none; z up. A file that cannot be read states nothing: loading
    its mesh reports the error.
    """
    with suppress(Exception):  # zipfile raises whatever its parsing trips over
        match file.suffix.lower() if file.is_file() else "":  # a pipe may block for ever
            case ".gltf" | ".glb":
                return 1.0, "y"
            case ".dae":
                return _collada(file)
            case ".3mf":
                return _threemf(file), "z"
    return None, None


def _collada(file: Path) -> tuple[float | None, str]:
    with file.open("rb") as stream:
        head = without_mark(file, stream.read(PART_HEAD_BYTES))
    head = COMMENT.sub(b"", head)
    unit = _attribute(head, rb"unit", rb"meter")
    axis = re.search(rb"<up_axis>\s*([XYZ])_UP", head)
    return _unit(unit) if unit else None, axis[1].decode().lower() if axis else "y"


def _threemf(file: Path) -> float | None:
    with file.open("rb") as content:
        package = Package(content)
        head = package.head(package.main)
    if not head:
        return None
    unit = _attribute(head, rb"model", rb"unit")
    return THREEMF.get(unit) if unit else 1e-3


def _attribute(text: bytes, tag: bytes, name: bytes) -> bytes | None:
    """Find an attribute of the first element with a tag; in two steps, each in time linear in the text's length."""
    element = re.search(rb"<" + tag + rb"\b([^>]*)", text)
    value = element and re.search(rb"\b" + name + rb"\s*=\s*[\"']([^\"']*)", element[1])
    return value[1] if value else None


def _unit(text: bytes) -> float | None:
    with suppress(ValueError):
        if LEAST_UNIT <= (number := float(text)) <= GREATEST_UNIT:
            return number
    return None

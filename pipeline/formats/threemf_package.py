"""The package of a 3MF file: a ZIP file of models in XML, textures, and relations that name the main model."""

import re
import zipfile
from array import array
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import IO, Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element, TreeBuilder

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import parse_xml
from pipeline.formats.mesh_parts import MAX_FACES, check_count
from pipeline.kernels.arrays import Array

MAX_ELEMENTS = 1_000_000  # maximum number of elements of a model beside its vertices and triangles
HEAD_BYTES = 65_536
"""Bytes within which a COLLADA or 3MF file states its unit: all that is read of it while objects are listed."""
MODEL = "3D/3dmodel.model"  # the usual name of the main model
RELATION, TARGET = re.compile(rb"<[^<>]*Relationship\s[^<>]*>"), re.compile(rb"\sTarget\s*=\s*[\"']([^\"']*)")
MAIN = re.compile(rb"\sType\s*=\s*[\"'][^\"']*/3dmodel[\"']")
"""A relation to the main model (Open Packaging Conventions, section 6.5)."""
PAINT = ("paint_color", "mmu_segmentation")
"""Attributes of triangles in which slicers store painted colours in a form of their own."""
PROPERTIES = ("pid", "p1", "p2", "p3")


@dataclass
class Model:
    """A model part: its root element, the numbers of its lists of vertices and triangles, and whether these have painted colours."""

    name: str
    root: Element
    numbers: Mapping[Element, "array[float]"]
    painted: bool

    @cached_property
    def resources(self) -> dict[str, Element]:
        """Its objects and properties by their ids, which count within it alone."""
        return {element.get("id", ""): element for element in self.root.iterfind("resources/*")}

    def table(self, mesh: Element, tag: str) -> Array:
        """Return the `vertices` (N, 3) of a mesh, or its `triangles` (N, 7): vertices, the group of properties, and numbers in it."""
        element = mesh.find(tag)
        numbers = array("d") if element is None else self.numbers.get(element, array("d"))
        return np.frombuffer(numbers).reshape(-1, 3 if tag == "vertices" else 7)


class Package:
    """The parts of a 3MF file by their names, of which upper and lower case are equal (Open Packaging Conventions, section 6.2)."""

    def __init__(self, file: IO[bytes]) -> None:
        try:
            self._archive = zipfile.ZipFile(file)
        except zipfile.BadZipFile as error:
            raise InvalidInput(f"it is no ZIP file, as 3MF files are ({error}); is it cut off?") from error
        self._names = {_normal(name): name for name in self._archive.namelist()}

    def __contains__(self, name: str) -> bool:
        return _normal(name) in self._names

    def open(self, name: str) -> IO[bytes]:
        """Open a part for reading."""
        if name not in self:
            raise InvalidInput(f"it names the part {name}, which is not in the file; export it again")
        return self._archive.open(self._names[_normal(name)])

    def head(self, name: str) -> bytes:
        """Read the first `HEAD_BYTES` of a part; none if its compression may expand to gigabytes."""
        usual = self._archive.getinfo(self._names[_normal(name)]).compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        with self.open(name) as stream:
            return stream.read(HEAD_BYTES) if usual else b""

    @cached_property
    def main(self) -> str:
        """The name of the main model: the one that relations name, or else the usual one."""
        relations = self.head("_rels/.rels") if "_rels/.rels" in self else b""
        named = [TARGET.search(relation) for relation in RELATION.findall(relations) if MAIN.search(relation)]
        models = [target[1].decode() for target in named if target] or [name for name in self._names if name.endswith(".model")]
        if not models:
            raise InvalidInput("it has no part that ends with .model; it is a ZIP file, not a 3MF")
        return MODEL if MODEL.lower() in models else models[0]


def _normal(name: str) -> str:
    return unquote(name).replace("\\", "/").lstrip("/").lower()


class _ModelTree(TreeBuilder):
    """Builds elements without prefixes; vertices and triangles become numbers, -1 for none, of the element that lists them."""

    def __init__(self) -> None:
        super().__init__()
        self.numbers = defaultdict[Element, "array[float]"](lambda: array("d"))
        self.painted = False
        self._open: list[Element] = []
        self._count = 0

    def start(self, name: str, attributes: dict[str, str]) -> Any:
        match name.rpartition(":")[2]:
            case "vertex":
                self.numbers[self._open[-1]].extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
            case "triangle":
                numbers = self.numbers[self._open[-1]]
                numbers.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"]), -1, -1, -1, -1))
                if len(attributes) > 3:
                    numbers[-4:] = array("d", [int(attributes.get(name, -1)) for name in PROPERTIES])
                    self.painted |= any(name.endswith(PAINT) for name in attributes)
                if len(numbers) > 7 * MAX_FACES:
                    check_count("faces", len(numbers) // 7, MAX_FACES, "decimate the mesh")
            case tag:
                self._count += 1
                check_count("elements of XML", self._count, MAX_ELEMENTS, "merge its objects")
                self._open.append(super().start(tag, {name.rpartition(":")[2]: value for name, value in attributes.items()}))

    def data(self, text: str) -> None:
        if text.strip():
            super().data(text)

    def end(self, name: str) -> Any:
        if (tag := name.rpartition(":")[2]) not in ("vertex", "triangle"):
            self._open.pop()
            super().end(tag)


def parse_model(name: str, stream: IO[bytes]) -> Model:
    """Parse a model part."""
    tree = _ModelTree()
    return Model(name, parse_xml(stream, tree), tree.numbers, tree.painted)

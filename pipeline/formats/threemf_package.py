"""The package of a 3MF file: a ZIP file of models in XML, textures, and relations that name the main model."""

import re
import zipfile
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import IO
from urllib.parse import unquote
from xml.parsers import expat

import numpy as np

from pipeline.errors import InvalidInput
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
TEXTS = ("metadata", "setting")  # elements whose text is kept
PROPERTIES = ("pid", "p1", "p2", "p3")


@dataclass
class Element:
    """An element of XML without its namespaces; a mesh has its vertices and triangles as numbers."""

    tag: str
    attributes: dict[str, str]
    children: list["Element"] = field(default_factory=list)
    numbers: "array[float]" = field(default_factory=lambda: array("d"))
    """Positions of `vertices`; of `triangles` three vertices, the group of their properties and three numbers in it, -1 for none."""

    text: str = ""

    def all(self, tag: str) -> Iterator["Element"]:
        """List the children of a tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> "Element":
        """Return the first child of a tag, or an empty element."""
        return next(self.all(tag), Element(tag, {}))

    @cached_property
    def table(self) -> Array:
        """(N, 3) positions or (N, 7) triangles."""
        return np.frombuffer(self.numbers).reshape(-1, 3 if self.tag == "vertices" else 7)


@dataclass
class Model:
    """A model part: its root element, the namespaces of prefixes, and whether triangles have painted colours."""

    name: str
    root: Element
    namespaces: dict[str, str]
    painted: bool = False

    @property
    def unit(self) -> str:
        """Its unit, "" where it states none."""
        return self.root.attributes.get("unit", "")

    @cached_property
    def resources(self) -> dict[str, Element]:
        """Its objects and properties by their ids, which count within it alone."""
        return {element.attributes.get("id", ""): element for element in self.root.first("resources").children}


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


def parse_model(name: str, stream: IO[bytes]) -> Model:
    """Parse a part in XML, without entities or other files (3MF core, section 2.3.1: no DTD)."""
    root = Element("", {})
    model, open_elements, count = Model(name, root, {}), [root], 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        tag, parent = name.rpartition(" ")[2], open_elements[-1]
        if tag == "triangle" and parent.tag == "triangles":
            parent.numbers.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"]), -1, -1, -1, -1))
            if len(attributes) > 3:
                parent.numbers[-4:] = array("d", [int(attributes.get(name, -1)) for name in PROPERTIES])
                model.painted |= any(name.endswith(PAINT) for name in attributes)
            if len(parent.numbers) > 7 * MAX_FACES:
                check_count("faces", len(parent.numbers) // 7, MAX_FACES, "decimate the mesh")
        elif tag == "vertex" and parent.tag == "vertices":
            parent.numbers.extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
        else:
            parser.CharacterDataHandler = data if tag in TEXTS else None
            count += 1
            check_count("elements of XML", count, MAX_ELEMENTS, "merge its objects")
            parent.children.append(Element(tag, {name.rpartition(" ")[2]: value for name, value in attributes.items()}))
            open_elements.append(parent.children[-1])
            return
        open_elements.append(parent)

    def data(text: str) -> None:
        open_elements[-1].text += text.strip()

    def end(_: str) -> None:
        open_elements.pop()

    def refuse_dtd(*_: object) -> None:
        raise InvalidInput("its XML has a document type, which 3MF forbids; export it again")

    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, refuse_dtd
    parser.StartNamespaceDeclHandler = lambda prefix, uri: model.namespaces.setdefault(prefix or "", uri or "")
    parser.ParseFile(stream)
    if not root.children:
        raise InvalidInput("a part of it has no XML; it is cut off")
    model.root = root.children[0]
    return model

"""3MF files: the objects that are built, with the colours of the core and materials specifications."""

import re
import zipfile
from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import IO, Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element, TreeBuilder

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import parse_xml
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import GREY, MAX_DEPTH, MAX_FACES, MAX_INSTANCES, build_part, check_corners, check_count, posed
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import compose

MAX_ELEMENTS = 1_000_000  # maximum number of elements of a model beside its vertices and triangles
PART_HEAD_BYTES = 65_536  # bytes within which a COLLADA or 3MF file states its unit: all that is read of it while objects are listed
MODEL = "3D/3dmodel.model"  # the usual name of the main model
RELATION, TARGET = re.compile(rb"<[^<>]*Relationship\s[^<>]*>"), re.compile(rb"\sTarget\s*=\s*[\"']([^\"']*)")
MAIN = re.compile(rb"\sType\s*=\s*[\"'][^\"']*/3dmodel[\"']")  # a relation to the main model (Open Packaging Conventions, section 6.5)
PAINT = ("paint_color", "mmu_segmentation")  # attributes of triangles in which slicers store painted colours in a form of their own
PROPERTIES = ("pid", "p1", "p2", "p3")
EXTENSIONS = ("core/", "material/", "production/", "slice/", "trianglesets/")
"""Parts of the names of the extensions that a file may require: those that are read, and two that do not change the mesh."""
NO_SHAPE = {"support": "a support", "solidsupport": "a support", "other": "a helper that is not built"}  # no part of the shape
COLORS = {"basematerials": "displaycolor", "colorgroup": "color"}  # groups of colours, and each entry's attribute that states it
UNREAD = {"compositematerials": "mixtures of materials", "multiproperties": "layers of properties", "texture2dgroup": "textures"}
"""Groups of properties that are not read."""
SLICER_VOLUMES = {
    "Metadata/Slic3r_PE_model.config": re.compile(rb"ParameterModifier|NegativeVolume|SupportEnforcer|SupportBlocker"),
    "Metadata/model_settings.config": re.compile(rb"modifier_part|negative_part|support_enforcer|support_blocker"),
}
"""Where PrusaSlicer, and Bambu Studio and its like, state which parts of an object are none of its shape, and their words for these."""
FILAMENTS = "Metadata/project_settings.config"  # where Bambu Studio and its like state the colours of filaments
CURA_VOLUMES = ("support_mesh", "anti_overhang_mesh", "cutting_mesh", "infill_mesh")  # Cura's settings of what is no part of the shape
SETTINGS = ("metadatagroup", "settings")  # elements of an object that hold its settings; the latter is of early versions of Cura


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
        """Read the first `PART_HEAD_BYTES` of a part; none if its compression may expand to gigabytes."""
        usual = self._archive.getinfo(self._names[_normal(name)]).compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        with self.open(name) as stream:
            return stream.read(PART_HEAD_BYTES) if usual else b""

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


def read_threemf(file: Companions, _: Textures) -> Iterator[Mesh]:
    """Read the meshes of a 3MF file in the poses of its build."""
    package, unread = Package(BytesIO(file.content)), file.unread
    for name, words in SLICER_VOLUMES.items():
        if name in package:
            with package.open(name) as stream:
                if word := words.search(stream.read()):
                    raise InvalidInput(f"it has volumes that modify others ({word[0].decode()} in {name}); export its parts as STL")
    if FILAMENTS in package:
        unread.append(f"colours of filaments ({FILAMENTS}) are not read")
    yield from _Builder(package, unread).build()


class _Builder:
    """The models of a package, parsed when they are first used."""

    def __init__(self, package: Package, unread: list[str]) -> None:
        self._package, self._unread = package, unread
        self._parts: dict[str, Model] = {}
        self._unit = ""  # of the main model, which is the first
        self._instances = 0

    def build(self) -> Iterator[Mesh]:
        """Build the items of the main model."""
        main = self._part(self._package.main)
        for number, item in enumerate(main.root.iterfind("build/item"), 1):
            if item.get("printable", "1") in ("0", "false"):
                self._unread.append(f"item {number} is skipped; it is marked as not printable")
            else:
                yield from self._place(main, item, np.eye(4), 0)

    def _part(self, name: str) -> Model:
        key = name.lower().lstrip("/")
        if key not in self._parts:
            with self._package.open(name) as stream:
                part = parse_model(name, stream)
            for prefix in part.root.get("requiredextensions", "").split():
                uri = part.root.get(prefix, prefix)  # of the declaration, `xmlns:PREFIX`
                if not any(known in uri for known in EXTENSIONS):
                    raise InvalidInput(f"it requires {uri}, which cannot be read; export it without that extension")
            self._unit = self._unit or part.root.get("unit", "millimeter")
            if (unit := part.root.get("unit", self._unit)) != self._unit:
                raise InvalidInput(f"its models are in {self._unit} and in {unit}; export it in one unit")
            if part.painted:
                self._unread.append("colours that a slicer painted on triangles are not read")
            self._parts[key] = part
        return self._parts[key]

    def _place(self, part: Model, reference: Element, pose: Array, depth: int) -> Iterator[Mesh]:
        """Build the object that an item or a component names, at a pose."""
        self._instances += 1
        check_count("components", self._instances, MAX_INSTANCES, "merge its objects")
        check_count("levels of components", depth, MAX_DEPTH, "one may contain itself; merge its objects")
        part = self._part(path) if (path := reference.get("path")) else part
        number = reference.attrib["objectid"]
        if (thing := part.resources.get(number)) is None or thing.tag != "object":
            raise InvalidInput(f"it names object {number} of {part.name}, which is not there; export it again")
        pose = compose(pose, _transform(reference))
        if (kind := thing.get("type", "model")) in NO_SHAPE:
            self._unread.append(f"object {number} is skipped; it is {NO_SHAPE[kind]}")
            return
        for setting in (setting for group in thing if group.tag in SETTINGS for setting in group):
            name = setting.get("name", setting.get("key", "")).removeprefix("cura:")
            if name in CURA_VOLUMES and (setting.text or "").strip().lower() == "true":
                self._unread.append(f"object {number} is skipped; Cura marks it as {name}")
                return
        for child in thing:
            if child.tag == "components":
                for component in child.findall("component"):
                    yield from self._place(part, component, pose, depth + 1)
            elif child.tag == "mesh":
                yield from self._mesh(part, thing, child, pose)
            elif child.tag not in SETTINGS:
                raise InvalidInput(f"object {number} is a {child.tag}, which cannot be read; export it as triangles")

    def _mesh(self, part: Model, thing: Element, mesh: Element, pose: Array) -> Iterator[Mesh]:
        name = f"object {thing.get('id')} of {part.name}"
        if other := {child.tag for child in mesh} - {"vertices", "triangles", "trianglesets", "metadatagroup"}:
            raise InvalidInput(f"{name} has a {min(other)}, which cannot be read; export it as triangles")
        if thing.get("meshresolution") == "lowres":
            raise InvalidInput(f"{name} has its shape in slices beside a mesh of low resolution; export it as triangles")
        vertices, triangles = part.table(mesh, "vertices"), part.table(mesh, "triangles").astype(np.int64)
        if "slicestackid" in thing.attrib and not len(triangles):
            raise InvalidInput(f"{name} has slices and no triangles; export it as triangles")
        if not len(triangles):
            return
        check_corners(triangles[:, :3], len(vertices))
        vertices, faces = posed(pose, vertices, triangles[:, :3])
        yield build_part(vertices, faces, face_color=self._face_colors(part, thing, triangles[:, 3:]))

    def _face_colors(self, part: Model, thing: Element, properties: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Find the colours (T, 4) of triangles from the group and the three numbers (T, 4) of their properties, or their object's."""
        if ((properties[:, 2:] >= 0) & (properties[:, 2:] != properties[:, 1:2])).any():
            self._unread.append("colours that differ at the corners of a triangle are not read, but the first")
        group, number = properties[:, 0], properties[:, 1]
        group = np.where(group < 0, int(thing.get("pid", -1)), group)
        number = np.where(number < 0, int(thing.get("pindex", 0)), number)
        colors = np.full((len(properties), 4), GREY, np.uint8)
        for used in np.unique(group).tolist():
            properties_used = part.resources.get(str(used), Element(""))
            if properties_used.tag in UNREAD:
                self._unread.append(f"{UNREAD[properties_used.tag]} ({properties_used.tag}) are not read")
            elif properties_used.tag in COLORS and len(properties_used):
                listed = [_color(entry.get(COLORS[properties_used.tag], "")) for entry in properties_used]
                colors[group == used] = np.array(listed, np.uint8)[np.minimum(number[group == used], len(listed) - 1)]
        return colors


def _transform(reference: Element) -> Array:
    """Read the pose (4, 4) of an item or a component (3MF core, section 3.3: of rows, four by three)."""
    pose = np.eye(4)
    if transform := reference.get("transform"):
        pose[:3] = np.array(transform.split(), np.float64).reshape(4, 3).T
    return pose


def _color(text: str) -> tuple[int, int, int, int]:
    if not re.fullmatch(r"#([0-9a-fA-F]{6}|[0-9a-fA-F]{8})", text.strip()):
        return GREY
    red, green, blue, opacity, *_ = (*bytes.fromhex(text.strip()[1:]), 255)
    return red, green, blue, opacity

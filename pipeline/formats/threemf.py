"""3MF files: the objects that are built, with the colours and textures of the core and materials specifications."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import (
    GREY,
    MAX_DEPTH,
    MAX_INSTANCES,
    WHITE,
    build_part,
    check_corners,
    check_count,
    posed,
    split_vertices,
)
from pipeline.formats.textures import Textures
from pipeline.formats.threemf_package import Model, Package, parse_model
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import compose

EXTENSIONS = ("core/", "material/", "production/", "slice/", "trianglesets/")
"""Parts of the names of the extensions that a file may require: those that are read, and two that do not change the mesh."""
NO_SHAPE = {"support": "a support", "solidsupport": "a support", "other": "a helper that is not built"}
"""Types of objects that are no part of the shape."""
COLORS = {"basematerials": "displaycolor", "colorgroup": "color"}
"""Groups of properties that are colours, and the attribute of each entry that states it."""
UNREAD = {"compositematerials": "mixtures of materials", "multiproperties": "layers of properties"}
"""Groups of properties that are not read."""
SLICER_VOLUMES = {
    "Metadata/Slic3r_PE_model.config": re.compile(rb"ParameterModifier|NegativeVolume|SupportEnforcer|SupportBlocker"),
    "Metadata/model_settings.config": re.compile(rb"modifier_part|negative_part|support_enforcer|support_blocker"),
}
"""Where PrusaSlicer, and Bambu Studio and its like, state which parts of an object are none of its shape, and their words for these."""
FILAMENTS = "Metadata/project_settings.config"  # where Bambu Studio and its like state the colours of filaments
CURA_VOLUMES = ("support_mesh", "anti_overhang_mesh", "cutting_mesh", "infill_mesh")
"""Cura's settings of an object that is no part of the shape."""
SETTINGS = ("metadatagroup", "settings")
"""Elements of an object that hold its settings; the latter is of early versions of Cura."""


def read_threemf(file: Companions, textures: Textures) -> Iterator[Mesh]:
    """Read the meshes of a 3MF file in the poses of its build."""
    package, unread = Package(BytesIO(file.content)), file.unread
    for name, words in SLICER_VOLUMES.items():
        if name in package:
            with package.open(name) as stream:
                if word := words.search(stream.read()):
                    raise InvalidInput(f"it has volumes that modify others ({word[0].decode()} in {name}); export its parts as STL")
    if FILAMENTS in package:
        unread.append(f"colours of filaments ({FILAMENTS}) are not read")
    yield from _Builder(package, textures).build()


@dataclass
class _Properties:
    """The entries of all groups of properties of a part: the first is grey, for none."""

    first: dict[int, int]  # the first entry of a group
    color: NDArray[np.uint8]  # (N, 4)
    uv: Array  # (N, 2)
    texture: NDArray[np.int64]  # (N,) index in `textures`, -1 for none
    textures: list[NDArray[np.uint8] | None]


class _Builder:
    """The models of a package, parsed when they are first used."""

    def __init__(self, package: Package, textures: Textures) -> None:
        self._package, self._textures, self._unread = package, textures, textures.unread
        self._parts: dict[str, Model] = {}
        self._properties: dict[str, _Properties] = {}
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
        table = self._table(part)
        entries = _entries(thing, triangles[:, 3:], table)
        varied = (entries != entries[:, :1]).any(axis=1) & (table.texture[entries[:, 0]] < 0)  # colours that differ at the corners
        face_color = table.color[np.where(varied, -1, entries[:, 0])]
        corner_color = np.where(varied[:, None], entries, -1)  # the last entry is white
        used = np.where(table.texture[entries] >= 0, entries, corner_color + len(table.color) * (corner_color < 0))
        vertex, entry, faces = split_vertices(triangles[:, :3], used)
        vertices, turned = posed(pose, vertices[vertex], faces)
        yield build_part(
            vertices,
            turned,
            face_color=face_color,
            vertex_color=table.color[entry] if varied.any() else None,
            uv=table.uv[entry],
            page=table.texture[entries[:, 0]],
            textures=table.textures,
        )

    def _table(self, part: Model) -> _Properties:
        """Read the properties of a part: entry 0 is none, the last one is white."""
        if part.name in self._properties:
            return self._properties[part.name]
        first, textures = dict[int, int](), list[NDArray[np.uint8] | None]()
        none = (GREY, (0.0, 0.0), -1)
        rows = [none]  # color, coordinates and number of the texture of each entry
        for number, group in part.resources.items():
            if group.tag not in (*COLORS, *UNREAD, "texture2dgroup"):
                continue
            first[int(number)] = len(rows)
            if group.tag in UNREAD:
                self._unread.append(f"{UNREAD[group.tag]} ({group.tag}) are not read")
            if group.tag == "texture2dgroup":
                textures.append(self._texture(part, group))
                color, page = (GREY, -1) if textures[-1] is None else (WHITE, len(textures) - 1)
                rows += [(color, (float(entry.attrib["u"]), float(entry.attrib["v"])), page) for entry in group]
            else:
                rows += [(_color(entry.get(COLORS.get(group.tag, ""), "")), *none[1:]) for entry in group]
        colors, uv, pages = zip(*rows, (WHITE, *none[1:]), strict=True)
        table = _Properties(first, np.array(colors, np.uint8), np.array(uv, np.float64), np.array(pages, np.int64), textures)
        return self._properties.setdefault(part.name, table)

    def _texture(self, part: Model, group: Element) -> NDArray[np.uint8] | None:
        texture = part.resources.get(group.attrib["texid"], group)
        path = texture.get("path", "")
        if path not in self._package:
            self._unread.append(f"{path} is missing in the 3MF")
            return None
        for axis in "uv":
            outside = any(not 0 <= float(entry.attrib[axis]) <= 1 for entry in group)
            if outside and (style := texture.get(f"tilestyle{axis}", "wrap")) != "wrap":
                self._unread.append(f"{path} is repeated where the file says {style}")
        with self._package.open(path) as stream:
            return self._textures.read(path, stream.read())


def _transform(reference: Element) -> Array:
    """Read the pose (4, 4) of an item or a component (3MF core, section 3.3: of rows, four by three)."""
    pose = np.eye(4)
    if transform := reference.get("transform"):
        pose[:3] = np.array(transform.split(), np.float64).reshape(4, 3).T
    return pose


def _entries(thing: Element, properties: NDArray[np.int64], table: _Properties) -> NDArray[np.int64]:
    """Find the entries (T, 3) of the corners of triangles from their group and numbers (T, 4), or those of their object."""
    group, numbers = properties[:, 0], properties[:, 1:]
    own_group = int(thing.get("pid", -1))
    whole = np.where(numbers[:, :1] < 0, int(thing.get("pindex", 0)), numbers[:, :1])
    numbers = np.where(numbers < 0, whole, numbers)
    group = np.where(group < 0, own_group, group)
    names = np.array(sorted(table.first), np.int64)
    firsts = np.array([0, *(table.first[name] for name in names.tolist())])
    index = np.searchsorted(names, group, side="right")
    exists = np.isin(group, names)[:, None]
    return np.where(exists, np.minimum(firsts[index][:, None] + numbers, len(table.color) - 2), 0)


def _color(text: str) -> tuple[int, int, int, int]:
    if not re.fullmatch(r"#([0-9a-fA-F]{6}|[0-9a-fA-F]{8})", text.strip()):
        return GREY
    red, green, blue, opacity, *_ = (*bytes.fromhex(text.strip()[1:]), 255)
    return red, green, blue, opacity

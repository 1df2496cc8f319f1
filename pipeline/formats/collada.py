"""COLLADA files: the polygons of the scene that they show, with the colours, opacities and textures of their effects (COLLADA 1.4.1)."""

from collections import ChainMap
from collections.abc import Iterator, Mapping
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import parse_xml
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import (
    MAX_DEPTH,
    MAX_INSTANCES,
    OPAQUE_WHITE,
    build_part,
    check_corners,
    check_count,
    cut_polygons,
    eight_bits,
    pose_matrix,
    posed,
    read_numbers,
    strip_corners,
)
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Array, Integers
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import compose, sin_cos

Fill = tuple[NDArray[np.uint8] | None, NDArray[np.uint8] | None]  # colour (4,) and texture
SURFACES = ("triangles", "polylist", "polygons", "tristrips", "trifans")
UNREAD_SHAPES = {  # elements that change the shape and are not read
    "instance_controller": "a skin or a morph (instance_controller)",
    "skew": "a skewed node",
    "lookat": "a node that looks at a point",
    "ph": "polygons with holes",
    "brep": "curved surfaces (brep)",
}
SHADERS = ("phong", "lambert", "blinn", "constant")
LUMINANCE = np.array([0.212671, 0.71516, 0.072169])  # of linear red, green and blue, as COLLADA 1.4.1 weighs them for RGB_ZERO


def read_collada(file: Companions, textures: Textures) -> Iterator[Mesh]:
    """Read the surfaces of the scene that a COLLADA file shows, each in its pose, in its own unit and axes."""
    return _Document(parse_xml(file.content), textures).scene()


class _Part(NamedTuple):
    """The corners of the triangles of a part: positions (3 T, 3), texture coordinates (3 T, 2) and colours (3 T, 4)."""

    symbol: str  # of its material
    positions: Array
    uv: Array | None
    color: NDArray[np.uint8] | None


class _Document:
    def __init__(self, root: Element, textures: Textures) -> None:
        self._root, self._textures, self._unread = root, textures, textures.unread
        for element in root.iter():
            element.tag = element.tag.rpartition(":")[2]
        self._by_id = _by_id(root)
        self._parts: dict[str, list[_Part]] = {}
        self._looks: dict[str, Fill] = {}
        self._instances = 0

    def scene(self) -> Iterator[Mesh]:
        """Build the surfaces of the scene that the file shows."""
        shown = self._root.find("scene/instance_visual_scene")
        if shown is None or (scene := self._named(shown.get("url"))) is None:
            raise InvalidInput("it shows no scene (instance_visual_scene); export it again")
        for node in scene.findall("node"):
            yield from self._node(node, np.eye(4), 0)

    def _named(self, url: str | None) -> Element | None:
        return _target(url, self._by_id)

    def _node(self, node: Element, pose: Array, depth: int) -> Iterator[Mesh]:
        self._instances += 1
        check_count("nodes", self._instances, MAX_INSTANCES, "merge its objects")
        check_count("levels of nodes", depth, MAX_DEPTH, "one may contain itself; merge its objects")
        if next(node.iter("instance_controller"), None) is not None:
            raise _unread_shape("instance_controller")
        if all(next(node.iter(tag), None) is None for tag in ("instance_geometry", "instance_node")):
            return  # of cameras and lights
        for part in node:
            pose = compose(pose, _transform(part))
        for part in node:
            if part.tag == "node":
                yield from self._node(part, pose, depth + 1)
            elif part.tag in ("instance_node", "instance_geometry"):
                if (target := self._named(part.get("url"))) is None:
                    self._unread.append(f"{part.tag} {part.get('url')} is skipped; it is not in the file")
                elif part.tag == "instance_node":
                    yield from self._node(target, pose, depth + 1)
                else:
                    yield from self._geometry(target, part, pose)

    def _geometry(self, geometry: Element, instance: Element, pose: Array) -> Iterator[Mesh]:
        name = geometry.get("id", "")
        if name not in self._parts:
            if geometry.find("brep") is not None:
                raise _unread_shape("brep")
            names = ChainMap(_by_id(geometry), self._by_id)  # some programs use the same ones in several geometries
            self._parts[name] = [self._part(surface, names) for surface in geometry.findall("mesh/*") if surface.tag in SURFACES]
        materials = {bound.get("symbol"): bound.get("target") for bound in instance.iter("instance_material")}
        for part in self._parts[name]:
            color, image = self._look(materials.get(part.symbol))
            vertices, faces = posed(pose, part.positions, np.arange(len(part.positions)).reshape(-1, 3))
            yield build_part(
                vertices,
                faces,
                face_color=None if color is None else np.tile(color, (len(faces), 1)),
                vertex_color=part.color,
                uv=part.uv,
                page=np.zeros(len(faces), np.int64),
                textures=(image,),
            )

    def _part(self, surface: Element, names: Mapping[str, Element]) -> _Part:
        """Read the triangles of a surface."""
        if surface.find("ph") is not None:
            raise _unread_shape("ph")
        inputs, stride = dict[str, tuple[int, Array]](), 1  # the first of each meaning: offset among the numbers of a corner, and values
        for given in surface.findall("input"):
            offset, source = int(given.get("offset", 0)), _target(given.get("source"), names)
            stride = max(stride, offset + 1)
            for named in source.findall("input") if source is not None and given.get("semantic") == "VERTEX" else [given]:
                if (meaning := named.get("semantic")) in ("POSITION", "TEXCOORD", "COLOR") and meaning not in inputs:
                    inputs[meaning] = offset, _source(named.get("source"), names)
        corners, sizes = _polygons(surface, stride)
        if not len(corners):
            return _Part("", np.empty((0, 3)), None, None)
        if "POSITION" not in inputs:
            raise InvalidInput(f"{surface.tag} of it have no positions; export it again")
        offset, positions = inputs["POSITION"]
        triangles, _ = cut_polygons(corners[:, offset], sizes, positions, self._unread)
        of = {meaning: _rows(values, corners[triangles.ravel(), column]) for meaning, (column, values) in inputs.items()}
        uv, levels = of.get("TEXCOORD"), of.get("COLOR")
        color = None if levels is None or levels.shape[1] not in (3, 4) else eight_bits(levels, fractions=True)
        return _Part(surface.get("material", ""), of["POSITION"][:, :3], None if uv is None else uv[:, :2], color)

    def _look(self, material: str | None) -> Fill:
        """Read colour and texture of a material; none of one that is not in the file."""
        key = material or ""
        if key not in self._looks:
            instance = None if (named := self._named(material)) is None else named.find("instance_effect")
            effect = None if instance is None else self._named(instance.get("url"))
            self._looks[key] = (None, None) if effect is None else self._paint(effect)
        return self._looks[key]

    def _paint(self, effect: Element) -> Fill:
        """Read an effect: its diffuse colour, or emission where that is the only colour, and opacity."""
        params = {param.get("sid"): param for param in effect.iter("newparam")}
        for sampler in effect.iter("sampler2D"):
            if wraps := [wrap for axis in "st" if (wrap := sampler.findtext(f"wrap_{axis}", "WRAP").strip()) != "WRAP"]:
                name = self._image(sampler.findtext("source", ""), params)
                self._unread.append(f"{name} repeats where coordinates are outside 0 to 1; the file says {wraps[0]}")
        shader = next((part for part in effect.iter() if part.tag in SHADERS), Element("constant"))
        diffuse, emission, transparent = (_first(shader.find(name)) for name in ("diffuse", "emission", "transparent"))
        shown = emission if _shows(emission) and not _shows(diffuse) else diffuse
        mode = shader.find("transparent").get("opaque", "A_ONE") if transparent is not None else "A_ONE"  # type: ignore[union-attr]
        opaque, stated = True, [1.0, 1.0, 1.0, 1.0]
        if transparent is not None and transparent.tag == "texture":
            opaque = mode != "A_ONE" or shown is None or shown.get("texture") != transparent.get("texture")
            if opaque:
                self._unread.append(f"the texture of opacities of effect {effect.get('id')} is not read")
            mode = "A_ONE"
        elif len(numbers := _numbers(transparent)) == 4:
            stated = numbers
        factor = (_numbers(_first(shader.find("transparency"))) or [1.0])[0]
        amount = factor * (float(LUMINANCE @ stated[:3]) if mode.startswith("RGB") else stated[3])
        color, image = np.array(OPAQUE_WHITE, np.uint8), None
        if shown is not None and shown.tag == "texture":
            image = self._textures.find(self._image(shown.get("texture", ""), params), opaque=opaque)
        elif len(numbers := _numbers(shown)) >= 3:
            color[:3] = np.rint(255 * np.clip(numbers[:3], 0, 1))
        color[3] = round(255 * float(np.clip(1 - amount if mode.endswith("ZERO") else amount, 0, 1)))
        return color, image

    def _image(self, name: str, params: Mapping[str | None, Element]) -> str:
        """Name the file of a texture: by its sampler, surface and image, or by some of them."""
        for path in ("sampler2D/source", "surface/init_from"):
            if name in params:
                name = (params[name].findtext(path) or name).strip()
        image = self._by_id.get(name)
        return name if image is None else (image.findtext("init_from") or name).strip()


def _by_id(root: Element) -> dict[str, Element]:
    return {name: element for element in root.iter() if (name := element.get("id"))}


def _target(url: str | None, names: Mapping[str, Element]) -> Element | None:
    return names.get((url or "").removeprefix("#"))


def _source(url: str | None, names: Mapping[str, Element]) -> Array:
    """Read the numbers (N, columns) of a source, without columns that have no name."""
    source = _target(url, names)
    accessor = None if source is None else source.find("technique_common/accessor")
    numbers = None if source is None or accessor is None else _target(accessor.get("source"), names)
    if accessor is None or numbers is None:
        raise InvalidInput(f"it names the source {url}, which is not there; export it again")
    stride, offset = int(accessor.get("stride", 1)), int(accessor.get("offset", 0))
    table = read_numbers((numbers.text or "").encode())[offset:]
    columns = [number for number, param in enumerate(accessor.findall("param")) if param.get("name")]
    return table[: len(table) // stride * stride].reshape(-1, stride)[:, columns or range(stride)]


def _unread_shape(tag: str) -> InvalidInput:
    return InvalidInput(f"it has {UNREAD_SHAPES[tag]}, which cannot be read; export it as GLB")


def _transform(part: Element) -> Array:
    """Read a part of the pose of a node, (4, 4)."""
    if part.tag in ("skew", "lookat"):
        raise _unread_shape(part.tag)
    if part.tag not in ("matrix", "translate", "rotate", "scale"):
        return np.eye(4)
    numbers = read_numbers((part.text or "").encode())
    if part.tag == "matrix":
        return numbers.reshape(4, 4)
    if part.tag == "rotate":
        sine, cosine = sin_cos(np.radians(numbers[3]) / 2)
        axis = numbers[:3] / max(float(np.linalg.norm(numbers[:3])), 1e-300)
        return pose_matrix((0, 0, 0), (*(axis * sine), cosine), (1, 1, 1))
    moves = part.tag == "translate"
    return pose_matrix(numbers if moves else (0, 0, 0), (0, 0, 0, 1), (1, 1, 1) if moves else numbers)


def _polygons(surface: Element, stride: int) -> tuple[Integers, Integers]:
    """Read the corners (C, stride) of a surface's polygons, one after the other, and the number of corners of each."""
    rows = [read_numbers((part.text or "").encode()).astype(np.int64).reshape(-1, stride) for part in surface.findall("p")]
    if surface.tag in ("tristrips", "trifans"):
        rows = [row[strip_corners(len(row), fan=surface.tag == "trifans").ravel()] for row in rows]
    corners = np.concatenate([np.empty((0, stride), np.int64), *rows])
    if surface.tag == "polylist":
        sizes = read_numbers(surface.findtext("vcount", "").encode()).astype(np.int64)
    elif surface.tag == "polygons":
        sizes = np.array([len(row) for row in rows], np.int64)
    else:
        sizes = np.full(len(corners) // 3, 3)
    if sizes.sum() != len(corners):
        raise InvalidInput(f"{surface.tag} of it have {len(corners)} corners, not {sizes.sum()}; the file is damaged")
    return corners, sizes


def _rows(values: Array, rows: Integers) -> Array:
    check_corners(rows, len(values))
    return values[rows]


def _first(part: Element | None) -> Element | None:
    return None if part is None else next(iter(part), None)


def _shows(color: Element | None) -> bool:
    return color is not None and (color.tag == "texture" or any(_numbers(color)[:3]))


def _numbers(element: Element | None) -> list[float]:
    """Read finite numbers; none if there is another word."""
    try:
        numbers = [float(word) for word in (element.text or "").split()] if element is not None else []
    except ValueError:
        return []
    return numbers if np.isfinite(numbers).all() else []

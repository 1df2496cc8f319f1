"""COLLADA files: the images that they name, and what trimesh reads wrongly: effects, and concave polygons, cut into fans."""

import html
import re
from collections.abc import Iterator, Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import decode_text
from pipeline.formats.mesh_parts import check_corners, is_concave, read_numbers, triangulate
from pipeline.kernels.arrays import Array

IMAGE = re.compile(rb"<image\b([^>]*)>(?:(?!</?image\b).)*?<init_from>([^<]*)</init_from>", re.DOTALL)
"""An image with its file. Surfaces contain `init_from` too, but with the id of an image."""
ID = re.compile(rb"\bid\s*=\s*[\"']([^\"']*)")
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
ENCODING = re.compile(rb"^\s*<\?xml[^>]*\bencoding\s*=\s*[\"']([\w-]+)")
EFFECTS = re.compile(rb"<library_effects\b.*?</library_effects>", re.DOTALL)
NOT_READ = {
    rb"instance_controller\b": "a skin or a morph (instance_controller)",
    rb"skew\b": "a skewed node",
    rb"lookat\b[^<]*</(\w+:)?lookat>((?!</?(\w+:)?node\b).)*<(\w+:)?instance_(geometry|node)\b": "a node that looks at a point",
    rb"ph\b": "polygons with holes",
    rb"brep\b": "curved surfaces (brep)",
}
"""What changes the shape and is not read, by the first element of it."""
SCENE = re.compile(rb"<(\w+:)?instance_visual_scene\b")
SHADERS = ("phong", "lambert", "blinn", "constant")
LUMINANCE = np.array([0.212671, 0.71516, 0.072169])
"""Of linear red, green and blue, as COLLADA 1.4.1 weighs them for RGB_ZERO."""
POLYGONS = re.compile(rb"<(polylist|polygons)\b([^>]*)>(.*?)</\1>", re.DOTALL)
VERTICES = re.compile(rb"<vertices\b([^>]*)>(.*?)</vertices>", re.DOTALL)
INPUT = re.compile(rb"<input\b[^>]*>")
CORNERS = re.compile(rb"<p>([^<]*)</p>")
SIZES = re.compile(rb"<vcount>([^<]*)</vcount>")
POSITIONS = rb"<source\b[^>]*\bid\s*=\s*[\"']%s[\"'].*?<float_array\b[^>]*>([^<]*)<.*?<accessor\b([^>]*)"
"""The numbers of a source, and the attributes of its accessor."""


def image_names(content: bytes) -> Iterator[tuple[str, str]]:
    """List the images of a file: id, and name of the file that holds it."""
    for attributes, name in IMAGE.findall(content):
        identity = ID.search(attributes)
        yield _text(identity[1]) if identity else "", _text(name)


def check_shape(content: bytes) -> None:
    """Refuse a file without a scene, or with shapes that are not read."""
    text = COMMENT.sub(b"", content)
    for pattern, name in NOT_READ.items():
        if re.search(rb"<(\w+:)?" + pattern, text, re.DOTALL):
            raise InvalidInput(f"it has {name}, which cannot be read; export it as GLB")
    if b"COLLADA" in text and not SCENE.search(text):
        raise InvalidInput("it shows no scene (instance_visual_scene); export it again")


def rewrite_effects(content: bytes, unread: list[str]) -> tuple[bytes, set[str]]:
    """Rewrite effects: opacity as the one number that trimesh reads; emission, where it is the only colour, as diffuse.

    Also return the names of the files whose alpha is an opacity: by `<transparent>`, COLLADA 1.4.1, chapter 7.
    """
    files, transparent = dict(image_names(content)), set[str]()
    encoding = ENCODING.match(content)

    def rewrite(effects: re.Match[bytes]) -> bytes:
        try:
            parser = ElementTree.XMLParser(encoding=encoding[1].decode() if encoding else "utf-8")
            library = ElementTree.fromstring(effects[0], parser)
        except (ElementTree.ParseError, ValueError, LookupError):  # a prefix, another encoding, or damaged, as the reader says
            return effects[0]
        for effect in library.iter("effect"):
            params = {param.get("sid"): param for param in effect.iter("newparam")}
            for name, wrap in _wraps(effect, params):
                unread.append(f"{files.get(name, name)} repeats where coordinates are outside 0 to 1; the file says {wrap}")
            for shader in [part for part in effect.iter() if part.tag in SHADERS]:
                _show_emission(shader)
                image = _set_opacity(shader)
                if image == "":
                    unread.append(f"the texture of opacities of effect {effect.get('id')} is not read")
                elif image is not None:
                    transparent.add(files.get(_image_id(image, params), ""))
        return bytes(ElementTree.tostring(library))

    return EFFECTS.sub(rewrite, content), transparent


def _show_emission(shader: Element) -> None:
    emission, diffuse = shader.find("emission"), shader.find("diffuse")
    if emission is None or not _shows(emission) or (diffuse is not None and _shows(diffuse)):
        return
    if diffuse is not None:
        shader.remove(diffuse)
    emission.tag = "diffuse"


def _shows(part: Element) -> bool:
    return part.find("texture") is not None or any(_numbers(part.find("color"))[:3])


def _set_opacity(shader: Element) -> str | None:
    """Replace what a shader says of opacity by one number, the last of `<transparent>`'s colour.

    Return the texture whose alpha multiplies it, as the shader names it; "" where it is not that of the diffuse colour, None without one.
    """
    transparent, transparency = shader.find("transparent"), shader.find("transparency")
    factors = [] if transparency is None else _numbers(transparency.find("float"))
    factor, image, mode = (factors or [1.0])[0], None, "A_ONE"
    color = [1.0, 1.0, 1.0, 1.0]
    if transparent is not None:
        mode, texture = transparent.get("opaque", mode), transparent.find("texture")
        stated = _numbers(transparent.find("color"))
        color = stated if len(stated) == 4 else color
        if texture is not None:
            same = mode == "A_ONE" and texture.get("texture") in {part.get("texture") for part in shader.findall("diffuse/texture")}
            image, mode = texture.get("texture") if same else "", "A_ONE"
    amount = factor * (float(LUMINANCE @ color[:3]) if mode.startswith("RGB") else color[3])
    for part in (transparent, transparency):
        if part is not None:
            shader.remove(part)
    opacity = float(np.clip(1 - amount if mode.endswith("ZERO") else amount, 0, 1))
    SubElement(SubElement(shader, "transparent"), "color").text = f"1 1 1 {opacity!r}"
    return image


def _wraps(effect: Element, params: Mapping[str | None, Element]) -> Iterator[tuple[str, str]]:
    """List the images that an effect does not repeat in both directions, and what it does."""
    for sampler in effect.iter("sampler2D"):
        wraps = [wrap for axis in "st" if (wrap := sampler.findtext(f"wrap_{axis}", "WRAP").strip()) != "WRAP"]
        if wraps:
            yield _image_id(sampler.findtext("source", ""), params), wraps[0]


def _image_id(name: str, params: Mapping[str | None, Element]) -> str:
    for path in ("sampler2D/source", "surface/init_from"):
        if name in params:
            name = (params[name].findtext(path) or name).strip()
    return name


def _numbers(part: Element | None) -> list[float]:
    """Read the numbers of an element; none where it is missing or has other words."""
    try:
        numbers = [] if part is None else [float(word) for word in (part.text or "").split()]
    except ValueError:
        return []
    return numbers if np.isfinite(numbers).all() else []


def _text(name: bytes) -> str:
    return html.unescape(decode_text(name)).strip()


def cut_concave(content: bytes) -> bytes:
    """Write the polygons of a COLLADA file as triangles where one of them is concave; those that are not understood stay."""
    sources = {_attribute(vertices[1], b"id"): _source_id(vertices[2], b"POSITION") for vertices in VERTICES.finditer(content)}

    def rewrite(polygons: re.Match[bytes]) -> bytes:
        inputs, numbers = INPUT.findall(polygons[3]), CORNERS.findall(polygons[3])
        offsets = [int(_attribute(given, b"offset") or 0) for given in inputs]
        vertices = _positions(content, sources.get(_source_id(polygons[3], b"VERTEX"), b""))
        if vertices is None or not numbers:
            return polygons[0]
        stride = max(offsets) + 1
        corners = read_numbers(b" ".join(numbers)).astype(np.int64).reshape(-1, stride)
        counts = SIZES.search(polygons[3])
        sizes = read_numbers(counts[1]).astype(np.int64) if counts else np.array([len(text.split()) // stride for text in numbers])
        column = next(offset for offset, given in zip(offsets, inputs, strict=True) if _attribute(given, b"semantic") == b"VERTEX")
        check_corners(corners[:, column], len(vertices))
        if sizes.sum() != len(corners) or not _any_concave(corners[:, column], sizes, vertices):
            return polygons[0]
        triangles, _ = triangulate(corners[:, column], sizes, vertices)
        listed = " ".join(map(str, corners[triangles].ravel().tolist())).encode()
        attributes = re.sub(rb"\bcount\s*=\s*[\"'][^\"']*[\"']", b"", polygons[2])
        return b'<triangles count="%d"%s>%s<p>%s</p></triangles>' % (len(triangles), attributes, b"".join(inputs), listed)

    return POLYGONS.sub(rewrite, content)


def _any_concave(corners: NDArray[np.int64], sizes: NDArray[np.int64], vertices: Array) -> bool:
    firsts = np.cumsum(sizes) - sizes
    several = ((firsts[sizes == size, None] + np.arange(size)) for size in np.unique(sizes[sizes > 3]))
    return any(bool(is_concave(vertices[corners[rows]]).any()) for rows in several)


def _positions(content: bytes, source: bytes) -> Array | None:
    """Read the positions (V, 3) of a source; None where there is none of this name."""
    match = re.search(POSITIONS % re.escape(source), content, re.DOTALL) if source else None
    return None if match is None else read_numbers(match[1]).reshape(-1, int(_attribute(match[2], b"stride") or 1))[:, :3]


def _source_id(text: bytes, semantic: bytes) -> bytes:
    named = (_attribute(given, b"source") for given in INPUT.findall(text) if _attribute(given, b"semantic") == semantic)
    return next(named, b"").removeprefix(b"#")


def _attribute(text: bytes, name: bytes) -> bytes:
    match = re.search(rb"\b" + name + rb"\s*=\s*[\"']([^\"']*)", text)
    return match[1] if match else b""

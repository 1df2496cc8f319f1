"""glTF files, text and binary, as far as it takes to say what they name and how much they ask for.

The format: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html.
"""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.textures import FORMATS

MAX_ENTRIES = 1_000_000
"""Commas and opening brackets of a glTF's JSON: each may become a hundred bytes."""

MAX_LEVELS = 64
"""Nodes from a root of the scene to a leaf: every mesh's pose is the product of all poses above it."""

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

SPECULAR = "KHR_materials_pbrSpecularGlossiness"
"""The extension whose textures are converted while they are read, once per material, in float64."""


def read_gltf(file: Path) -> tuple[dict[str, Any], bytes]:
    """Read the JSON of a glTF file, and the binary data that follow it in a GLB file.

    Raises
    ------
    InvalidInput
        It is no glTF file, or its JSON has too many entries or is nested too deep.
    """
    content, binary = file.read_bytes(), b""
    if file.suffix.lower() == ".glb":
        size = int.from_bytes(content[12:16], "little")
        content, binary = content[20 : 20 + size], content[28 + size :]
    if (entries := sum(content.count(mark) for mark in (b",", b"[", b"{"))) > MAX_ENTRIES:
        raise InvalidInput(f"{file.name} has {entries} entries in its JSON, {MAX_ENTRIES} are the most; join its nodes and meshes")
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{file.name} cannot be read as {file.suffix[1:].upper()}: {error}") from error
    if not isinstance(tree, dict):
        raise InvalidInput(f"{file.name} cannot be read as {file.suffix[1:].upper()}: its JSON is no object")
    return tree, binary


def numbers_asked_for(tree: dict[str, Any]) -> int:
    """Count the numbers that a glTF's views, accessors and primitives copy, where each may name the same data."""
    accessors, primitives = tree.get("accessors", []), _primitives(tree)
    sizes = [accessor["count"] * WIDTHS[accessor["type"]] for accessor in accessors]
    used = [number for one in primitives for number in (*one["attributes"].values(), *([one["indices"]] if "indices" in one else []))]
    views = sum(view["byteLength"] for view in tree.get("bufferViews", [])) // 4
    return int(max(views, sum(sizes), sum(sizes[number] for number in used)))


def parts_asked_for(tree: dict[str, Any]) -> int:
    """Count the meshes' primitives, the nodes, their edges, or the primitives of all nodes, whichever are most."""
    nodes = tree.get("nodes", [])
    drawn = sum(len(tree["meshes"][node["mesh"]]["primitives"]) for node in nodes if "mesh" in node)
    return max(len(_primitives(tree)), len(nodes), sum(len(node.get("children", [])) for node in nodes), drawn)


def levels(tree: dict[str, Any]) -> int:
    """Count the levels of a glTF's nodes, not beyond `MAX_LEVELS` + 1: nodes may name each other in a circle."""
    nodes, count = tree.get("nodes", []), 0
    level = {node for scene in tree.get("scenes", []) for node in scene.get("nodes", [])}
    while level and count <= MAX_LEVELS:
        level = {child for node in level for child in nodes[node].get("children", [])}
        count += 1
    return count


def converted_pixels(tree: dict[str, Any], binary: bytes, read: Callable[[str], bytes]) -> int:
    """Count the pixels of the images that are converted while a glTF is read, from the images' headers."""
    extensions = [material.get("extensions", {}).get(SPECULAR, {}) for material in tree.get("materials", [])]
    textures = [value["index"] for extension in extensions for value in extension.values() if isinstance(value, dict)]
    images = Counter(tree["textures"][texture].get("source", -1) for texture in textures)  # -1: of a format that is not converted
    content = cache(lambda uri: base64.b64decode(uri.partition("base64,")[2]) if "base64," in uri else read(uri))
    return sum(count * _pixels(tree, tree["images"][image], binary, content) for image, count in images.items() if image >= 0)


def _primitives(tree: dict[str, Any]) -> list[Any]:
    return [primitive for mesh in tree.get("meshes", []) for primitive in mesh["primitives"]]


def _pixels(tree: dict[str, Any], image: dict[str, Any], binary: bytes, read: Callable[[str], bytes]) -> int:
    """Count the pixels of an image; none where it cannot be read, which loses its look and not the mesh."""
    try:
        if "bufferView" in image:
            view = tree["bufferViews"][image["bufferView"]]
            uri, start = tree["buffers"][view["buffer"]].get("uri"), view.get("byteOffset", 0)
            content = (read(uri) if uri else binary)[start : start + view["byteLength"]]
        else:
            content = read(image["uri"])
        with Image.open(BytesIO(content), formats=FORMATS) as opened:
            return opened.width * opened.height
    except Exception:  # Pillow's readers raise whatever their parsing trips over
        return 0

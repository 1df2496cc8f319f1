"""The material libraries of OBJ files: colours, opacity and textures; what is not read of a material is said."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import decode_text, foreign_content, without_mark
from pipeline.formats.mesh_parts import GREY, OPAQUE_WHITE
from pipeline.formats.textures import Textures

OPTIONS = re.compile(r"(-[a-zA-Z_]+\s+((on|off|[lmrgbz]|-?[\d.]+)\s+)*)+(?=\S)")  # what may precede the name of a texture, as `-s 1 1 1`
MOVED = re.compile(r"-[sot](\s+-?\.?\d[\d.]*)+")  # options that scale, move or disturb texture coordinates
STILL = re.compile(r"-s(\s+1(\.0*)?)+|-[ot](\s+-?\.?0[0.]*)+")  # those that leave them as they are
CLAMP = re.compile(r"-clamp\s+on\b")
Material = dict[str, str]  # statements by their words in lower case; those of numbers hold as many finite ones as they need


def read_library(
    name: str,
    content: bytes,
    materials: dict[str, list[Material]],  # gets the definitions of each name that differ, the last one valid
    unread: list[str],
) -> list[str]:
    """Read a material library; list the names of its textures."""
    try:
        text = decode_text(without_mark(name, content))
    except InvalidInput as error:
        unread.append(str(error))
        return []
    lines = [line for raw in text.splitlines() if (line := raw.strip()) and not line.startswith("#")]
    if not content or "\0" in text or (lines and not any(line.lower().startswith("newmtl") for line in lines)):
        unread.append(f"{name} is {foreign_content(content) or 'not a material library'}")
        return []
    defined, material, textures = list[tuple[str, Material]](), Material(), list[str]()
    for line in lines:
        word, _, rest = line.replace("\t", " ").partition(" ")
        key, rest = word.lower(), rest.strip()
        match key:
            case "newmtl":
                material = Material()
                defined.append((" ".join(rest.split()), material))
            case "kd" | "ke" | "d" | "tr":
                count, values = (3 if key in ("kd", "ke") else 1), _finite_numbers(rest.split())
                if len(values) in (1, count):
                    material[key] = " ".join(map(repr, values * (count // len(values))))
                else:
                    unread.append(f"{line} of material {defined[-1][0] if defined else ''} in {name} is not read")
            case "map_kd" | "map_ka" | "map_ke" | "map_d":
                material[key] = rest
                textures += [rest] if key == "map_kd" else []
    for title, material in defined:
        materials[title] = [other for other in materials.get(title, []) if other != material] + [material]
    return textures


def _finite_numbers(words: Sequence[str]) -> list[float]:
    """Read the finite numbers of a statement, up to a comment and without `-halo`; none if another word is among them."""
    ended = next((number for number, word in enumerate(words) if word.startswith("#")), len(words))
    try:
        numbers = [float(word) for word in words[:ended] if word != "-halo"]
    except ValueError:
        return []
    return numbers[:3] if np.isfinite(numbers).all() else []


def read_material(
    name: str, material: Material, textures: Textures
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None, str]:  # colour (4,); texture; what is wrong where coordinates are outside 0 to 1
    """Read the look of a material; note what of it is not read."""
    unread, stated, outside = textures.unread, material.get("map_kd", ""), ""
    file = _file(stated)
    keeps_alpha = "map_d" in material and _file(material["map_d"]) == file
    texture = textures.find(stated, opaque=not keeps_alpha) if stated else None
    color = np.array(GREY if texture is None else OPAQUE_WHITE, np.uint8)
    if texture is None:
        diffuse, light = (np.clip([float(number) for number in material.get(key, "").split()], 0, 1) for key in ("kd", "ke"))
        shown = light if light.any() and not diffuse.any() else diffuse
        color[: len(shown)] = np.rint(255 * shown)
        unread += [f"{word} of material {name} is not read" for word in ("map_Ka", "map_Ke") if word.lower() in material]
    else:
        if CLAMP.search(stated):
            outside = f"{file} is clamped (-clamp on), and repeats here where coordinates are outside 0 to 1"
        if moved := [option[0] for option in MOVED.finditer(stated) if not STILL.fullmatch(option[0])]:
            unread.append(f"{' '.join(moved)} of {file} is not applied")
    if "map_d" in material and not (texture is not None and keeps_alpha):
        unread.append(f"map_d {_file(material['map_d'])} of material {name} is not read")
    color[3] = round(255 * _opacity(material))
    return color, texture, outside


def _opacity(material: Material) -> float:
    """Read the opacity of a material, 0 to 1: `d`, else 1 - `Tr`, where 1 is opaque too, as early versions of MeshLab write it."""
    transparency = float(material.get("tr", 0))
    stated = float(material.get("d", 1 - transparency if transparency < 1 else 1))
    return float(np.clip(stated, 0, 1))


def _file(text: str) -> str:
    return text[match.end() :] if (match := OPTIONS.match(text)) else text

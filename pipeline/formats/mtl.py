"""Materials of MTL files: what is in them that trimesh does not read."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import decode_text, foreign_content, without_mark

OPTIONS = re.compile(r"(-[a-zA-Z_]+\s+((on|off|[lmrgbz]|-?[\d.]+)\s+)*)+(?=\S)")
"""What may stand before the name of a texture, as `-s 1 1 1`."""
MOVED = re.compile(r"-[sot](\s+-?\.?\d[\d.]*)+")
"""Options that scale, move or disturb texture coordinates."""
STILL = re.compile(r"-s(\s+1(\.0*)?)+|-[ot](\s+-?\.?0[0.]*)+")
"""Those that leave them as they are."""
CLAMP = re.compile(r"-clamp\s+on\b")
Values = Mapping[str, Any]
"""The entries of a material by their names in lower case, as trimesh keeps them: lists of words, or numbers of colours."""


def read_library(name: str, content: bytes, unread: list[str]) -> bytes:
    """Return the statements of a material library that trimesh reads: one that it cannot read would cost all materials."""
    try:
        text = decode_text(without_mark(name, content))
    except InvalidInput as error:
        unread.append(str(error))
        return b""
    lines = [line for raw in text.splitlines() if (line := raw.strip()) and not line.startswith("#")]
    if not content or "\0" in text or (lines and not any(line.lower().startswith("newmtl") for line in lines)):
        unread.append(f"{name} is {foreign_content(content) or 'not a material library'}")
        return b""
    kept, material = list[str](), ""
    for line in lines:
        key, *words = line.split()
        match key.lower():
            case "newmtl":
                material = " ".join(words)
                kept.append(line)
            case "kd" | "ke" | "d" | "tr":
                count, values = (3 if key[0] in "kK" else 1), _numbers(words)
                if len(values) in (1, count):
                    kept.append(" ".join([key, *map(repr, values * (count // len(values)))]))
                else:
                    unread.append(f"{line} of material {material} in {name} is not read")
            case "map_kd" | "map_ka" | "map_ke" | "map_d":
                kept.append(line)
    return "\n".join(kept).encode()


def _numbers(words: Sequence[str]) -> list[float]:
    """Read the finite numbers of a statement, up to a comment and without `-halo`; none if another word is among them."""
    ended = next((number for number, word in enumerate(words) if word.startswith("#")), len(words))
    try:
        numbers = [float(word) for word in words[:ended] if word != "-halo"]
    except ValueError:
        return []
    return numbers[:3] if np.isfinite(numbers).all() else []


def opacity(values: Values) -> float:
    """Read the opacity of a material, 0 to 1: `d`, else 1 - `Tr`, where 1 is opaque too, as early versions of MeshLab write it."""
    transparency = float(values["tr"][0]) if "tr" in values else 0.0
    stated = float(values["d"][0]) if "d" in values else 1 - transparency if transparency < 1 else 1.0
    return float(np.clip(stated, 0, 1))


def keeps_alpha(values: Values, texture: str) -> bool:
    """Check whether the alpha of a texture is an opacity: `map_d` names the same file."""
    return "map_d" in values and _file(" ".join(values["map_d"])) == _file(texture)


def emission(values: Values) -> NDArray[np.float64] | None:
    """Read the colour that a material emits, (3,) in 0 to 1, if it has no other one."""
    light = np.clip(np.array(values.get("ke", [0.0]), np.float64), 0, 1)
    return light if light.any() and not np.any(values.get("kd", 0.0)) else None


def losses(material: Any, uv: np.ndarray | None) -> Iterator[str]:
    """Name what is not read of one of trimesh's materials of an OBJ, with texture coordinates (V, 2)."""
    values = getattr(material, "kwargs", {})
    image = getattr(material, "image", None)
    texture = None if image is None else str(image.info.get("file_path", ""))
    if texture is None:
        yield from (f"{word} of material {material.name} is not read" for word in ("map_Ka", "map_Ke") if word.lower() in values)
    if texture and uv is not None and CLAMP.search(texture) and (np.abs(np.asarray(uv) - 0.5) > 0.5 + 1e-6).any():
        yield f"{_file(texture)} is clamped (-clamp on), and repeats here where coordinates are outside 0 to 1"
    if texture and (moved := [option[0] for option in MOVED.finditer(texture) if not STILL.fullmatch(option[0])]):
        yield f"{' '.join(moved)} of {_file(texture)} is not applied"
    if "map_d" in values and not (texture and keeps_alpha(values, texture)):
        yield f"map_d {_file(' '.join(values['map_d']))} of material {material.name} is not read"


def _file(text: str) -> str:
    """Return the file that a texture statement names, without options."""
    return text[match.end() :] if (match := OPTIONS.match(text)) else text

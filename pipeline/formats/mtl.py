"""Materials of MTL files: what is in them that trimesh does not read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import foreign_content, without_mark

OPTIONS = re.compile(r"(-[a-zA-Z_]+\s+((on|off|[lmrgbz]|-?[\d.]+)\s+)*)+(?=\S)")
"""What may stand before the name of a texture, as `-s 1 1 1`."""

MOVED = re.compile(r"-[st]\s+[-\d.]+(\s+[-\d.]+)*|-o\s+[-\d.]+(\s+[-\d.]+)*")
"""Options that scale, move or disturb texture coordinates."""

STILL = re.compile(r"-s(\s+1(\.0*)?)+|-[ot](\s+-?0?\.?0*)+")
"""Those that leave them as they are."""

CLAMP = re.compile(r"-clamp\s+on\b")

Values = Mapping[str, Any]
"""The entries of a material by their names in lower case, as trimesh keeps them: lists of words, or numbers of colours."""


def read_library(name: str, content: bytes) -> bytes:
    """Return the text of a material library without its byte-order mark; raise an `InvalidInput` if it is none."""
    text = without_mark(name, content)
    statements = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(b"#")]
    if not content or b"\0" in text or (statements and b"newmtl" not in text.lower()):
        raise InvalidInput(f"{name} is {foreign_content(content) or 'not a material library'}")
    return text


def opacity(values: Values) -> float:
    """Read the opacity of a material, 0 to 1: `d`, else 1 - `Tr`."""
    stated, transmitted = (_last_number(values.get(name)) for name in ("d", "tr"))
    return float(np.clip(1 - (transmitted or 0.0) if stated is None else stated, 0, 1))


def keeps_alpha(values: Values, texture: str) -> bool:
    """Check whether the alpha of a texture is an opacity: `map_d` names the same file."""
    return "map_d" in values and _file(" ".join(values["map_d"])) == _file(texture)


def emission(values: Values) -> list[float] | None:
    """Read the colour that a material without another one emits, (3,) in 0 to 1; None if it has another one, or emits none."""
    light, diffuse = ([number for word in np.ravel(values.get(name, [])) if (number := _number(word)) is not None] for name in ("ke", "kd"))
    return light if len(light) == 3 and any(light) and not any(diffuse) else None


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


def _last_number(words: Any) -> float | None:
    return _number(words[-1]) if isinstance(words, list) and words else None


def _number(word: object) -> float | None:
    try:
        return float(str(word))
    except ValueError:
        return None

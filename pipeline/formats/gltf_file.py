"""glTF files, text and binary: the JSON, which names their other files. The format: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipeline.errors import InvalidInput

MAX_ENTRIES = 1_000_000
"""Commas and opening brackets of a glTF's JSON: each may become a hundred bytes."""

MAX_FOREIGN = 2**25
"""Bytes of a JSON that is not ASCII: as text, a single character beyond it makes all others four times as large."""


def read_gltf(file: Path) -> dict[str, Any]:
    """Read the JSON of a glTF file.

    Raises
    ------
    InvalidInput
        It is no glTF file, or its JSON has too many entries, is too large or is nested too deep.
    """
    content = file.read_bytes()
    if file.suffix.lower() == ".glb":
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    if (entries := sum(content.count(mark) for mark in (b",", b"[", b"{"))) > MAX_ENTRIES:
        raise InvalidInput(f"{file.name} has {entries} entries in its JSON, {MAX_ENTRIES} are the most; join its nodes and meshes")
    if len(content) > MAX_FOREIGN and not content.isascii():
        raise InvalidInput(f"{file.name} has {len(content)} bytes of JSON, {MAX_FOREIGN} are the most unless all is ASCII; write it as GLB")
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{file.name} cannot be read as {file.suffix[1:].upper()}: {error}") from error
    if not isinstance(tree, dict):
        raise InvalidInput(f"{file.name} cannot be read as {file.suffix[1:].upper()}: its JSON is no object")
    return tree

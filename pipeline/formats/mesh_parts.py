"""Build parts of a mesh from what readers of files find: corners, colours and texture coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput

Decode = Callable[[str, bytes], "NDArray[np.uint8] | None"]
"""Decode the texture of this name and content to (height, width, 4); None, and an entry of `unread`, if that fails."""

MAX_UV = 2.0**20
"""Repeats of a texture beyond which float32 cannot tell its pixels apart: such coordinates are damaged, and become 0."""

GREY = (178, 178, 178, 255)
"""The colour of faces without a material, as 3D Warehouse's default material."""

WHITE = (255, 255, 255, 255)

MAX_FACES = 2_000_000
"""Maximum number of faces of a mesh file, and a third of that of vertices. More would take gigabytes, whatever `max_faces` allows."""


def check_count(what: str, number: int, limit: int, remedy: str) -> None:
    """Refuse a mesh file with too many faces, vertices, pixels, …."""
    if number > limit:
        raise InvalidInput(f"it has {number} {what}, {limit} are the most; {remedy}")


def check_mesh(faces: int, vertices: int) -> None:
    """Refuse a mesh file with too many faces or vertices."""
    check_count("faces", faces, MAX_FACES, "decimate the mesh")
    check_count("vertices", vertices, 3 * MAX_FACES, "decimate the mesh")

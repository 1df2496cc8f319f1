"""Scene files: the YAML descriptions of cameras, lamp, constant light and background.

A file of its own: code that reads other descriptions does not depend on cameras, so their keys do not either.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.formats.description_file import description_path, read_description
from pipeline.kernels.vision.scene import Scene


def load_scene(name: str | Path) -> Scene:
    """Read a scene by the name of a shipped scene or by path; an `InvalidInput` names the file and what is wrong with it."""
    return read_description("scene", description_path("scene", name), Scene)

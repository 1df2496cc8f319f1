"""Scene files: the YAML descriptions of cameras, lamp, constant light and background.

A separate module, so that code that reads other descriptions, and its keys, do not depend on cameras.
"""

from pathlib import Path

from pipeline.formats.description_file import description_path, read_description
from pipeline.kernels.vision.scene import Scene


def load_scene(name: str | Path) -> Scene:
    """Read a scene by the name of a shipped scene or by path; raise an `InvalidInput` that names the file and the fault."""
    return read_description("scene", description_path("scene", name), Scene)

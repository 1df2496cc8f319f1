"""The versions of what results depend on, as every output records them."""

from __future__ import annotations

import importlib.metadata

LIBRARIES = ("vt-pipeline", "numpy", "scipy", "torch", "trimesh", "pybullet", "embreex", "libigl", "numba", "pyrender-maintained", "zarr")


def library_versions() -> dict[str, str]:
    """Name and version of every library that results depend on."""
    return {name: importlib.metadata.version(name) for name in LIBRARIES}

"""Versions of libraries and properties of the processor, which results depend on and every output records."""

import importlib.metadata
import platform
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

LIBRARIES = ("vt-pipeline", "numpy", "scipy", "torch", "trimesh", "embreex", "libigl", "numba", "pyrender-maintained", "zarr")
PHYSICS = ("pybullet", "pybullet-arm64")
"""Packages of PyBullet: its own has no wheels beyond Python 3.11. Both give identical results."""


def library_versions() -> dict[str, str]:
    """Look up the version of every library that results depend on."""
    versions = {name: importlib.metadata.version(name) for name in LIBRARIES}
    for name in PHYSICS:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return versions


def processor() -> dict[str, Any]:
    """Describe the processor as far as results depend on it: `machine`, `model`, instruction sets of `numpy`, `torch`.

    Those of torch are given where it is imported already. Surfaces, grasps, images and touches are the same on every
    processor with FMA. Training and charts are not: BLAS and torch choose their kernels by processor.
    """
    config: Any = np.show_config(mode="dicts")
    simd = config["SIMD Extensions"]
    description = {"machine": platform.machine(), "model": _model(), "numpy": [*simd["baseline"], *simd.get("found", [])]}
    if torch := sys.modules.get("torch"):
        description["torch"] = torch.backends.cpu.get_cpu_capability()
    return description


def _model() -> str:
    """Return the processor's name as Linux gives it, else as Python does."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.processor())

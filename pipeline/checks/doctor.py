"""Check that everything the stages need is installed, and say how to install what is missing."""

import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

APT = "apt-get install -y libegl1 libgl1 libxrender1 libgl1-mesa-dri"  # what Debian and Ubuntu need for rendering without a screen
LEARNING = ("safetensors", "tensorboard")

MODULES = ("torch", "pybullet", "trimesh", "embreex", "igl", "numba", "zarr", "scipy", "matplotlib", "xarray", *LEARNING)


@dataclass(frozen=True)
class Check:
    """The result of one check, and the remedy if it failed."""

    subject: str
    ok: bool
    remedy: str = ""


def examine() -> Iterator[Check]:
    """Check the interpreter, the packages, headless rendering and the graphics card, in that order."""
    version = ".".join(map(str, sys.version_info[:3]))
    yield Check(f"Python {version}", (3, 11) <= sys.version_info < (3, 14), "use Python 3.11, 3.12 or 3.13")
    attempts: list[tuple[str, Callable[[], str], str]]
    attempts = [(f"import {name}", partial(_version, name), "pip install -c constraints.txt -e .") for name in MODULES]
    for subject, action, remedy in [*attempts, ("headless rendering (render-vision only)", _render, f"as root: {APT}")]:
        try:
            yield Check(f"{subject}: {action()}", True)
        except Exception as error:  # whatever a broken installation raises
            yield Check(f"{subject}: {type(error).__name__}: {error}", False, remedy)
    yield Check(f"torch device: {_device()}", True)


def _version(name: str) -> str:
    if name == "pybullet":
        importlib.import_module("pipeline.physics.simulation")  # imports it without the line that it prints
    module = importlib.import_module(name)
    return str(getattr(module, "__version__", "installed"))


def _render() -> str:
    from pipeline.formats.scene_file import load_scene
    from pipeline.kernels.vision.camera import projection_matrix  # imported here: they need what is being checked
    from stages.render_vision.renderer import Renderer

    scene = load_scene("supplement")
    with Renderer(scene, 16) as renderer:
        image = renderer.render_colors([])
    return f"{image.shape[0]} × {image.shape[1]} pixels, camera {projection_matrix(scene.camera).shape}"


def _device() -> str:
    try:
        import torch
    except Exception:  # whatever a broken installation raises
        return "none, torch cannot be imported"
    return torch.cuda.get_device_name() if torch.cuda.is_available() else "CPU (learning stages are slower; nothing else changes)"

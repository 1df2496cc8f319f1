"""Renderers in fresh processes, without OpenGL, and over many objects."""

import os
import subprocess
import sys

import numpy as np
import pytest

from pipeline.kernels.geometry.mesh import Look, Mesh
from tests.kernels.vision.shapes import SCENE, ball
from tests.stages.render_vision.test_renderer import seen

PROCESS = """
import hashlib, sys, numpy as np
from tests.kernels.vision.shapes import SCENE, HERE, ball, box, card, half_turned
from stages.render_vision.renderer import Renderer
from pipeline.kernels.vision.scene import Label
texture = np.random.default_rng(1).integers(0, 256, (50, 70, 4)).astype(np.uint8)
digest = hashlib.sha256()
with Renderer(SCENE) as renderer:
    # Two copies of one ball in different labels: which of two coincident faces shows must not change from run to run.
    meshes = [(half_turned(ball()), Label.OBJECT), (ball(color=(9, 9, 200)), Label.HAND), (box(), Label.OBJECT)]
    meshes.append((card(0.2, texture), Label.OBJECT))
    parts = [(renderer.add(mesh, label), HERE) for mesh, label in meshes]
    for _ in range(2):
        view = renderer.render(parts)
        digest.update(view.rgb.tobytes() + view.segmentation.tobytes())
print(digest.hexdigest())
"""


def run(code: str, **variables: str) -> str:
    """Run `code` in a fresh process and return its output."""
    environment = {
        name: value for name, value in os.environ.items() if name not in ("PYOPENGL_PLATFORM", "LP_NATIVE_VECTOR_WIDTH")
    } | variables
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout


def test_images_are_equal_in_every_process_and_on_every_processor() -> None:
    assert run(PROCESS, PYTHONHASHSEED="1") == run(
        PROCESS, PYTHONHASHSEED="2", LP_NATIVE_VECTOR_WIDTH="512", GALLIUM_OVERRIDE_CPU_CAPS="avx"
    )


def test_missing_opengl_names_the_packages_and_leaves_the_environment() -> None:
    code = """
import os
from tests.kernels.vision.shapes import SCENE
from stages.render_vision.renderer import NoOpenGL
from stages.render_vision.renderer import Renderer
try:
    Renderer(SCENE)
except NoOpenGL as error:
    print(error)
print("PYOPENGL_PLATFORM" in os.environ or "LP_NATIVE_VECTOR_WIDTH" in os.environ)
"""
    without = run(code, __EGL_VENDOR_LIBRARY_DIRS="/nowhere")  # libglvnd finds no driver there
    assert "apt-get install libegl1 libgl1 libxrender1 libgl1-mesa-dri" in without
    assert without.endswith("False\n")
    assert run(code) == "False\n"


def test_rendering_process_can_load_torchs_compiler() -> None:
    """PyPI's torch for GPUs comes with triton, whose LLVM ends a process where Mesa's was loaded first."""
    pytest.importorskip("triton")
    code = "from tests.kernels.vision.shapes import SCENE; from stages.render_vision.renderer import Renderer; Renderer(SCENE); "
    assert run(code + "import torch._dynamo; print('there')") == "there\n"


def resident_megabytes() -> float:
    """Megabytes of this process in memory."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.parametrize("objects", [60, pytest.param(300, marks=pytest.mark.slow)])
def test_memory_does_not_grow_with_objects(renderer, objects) -> None:
    rng = np.random.default_rng(0)

    def one() -> None:
        texture = rng.integers(0, 256, (500, 500, 4)).astype(np.uint8)  # 1 MB: kept by OpenGL, fifty of them would show
        mesh = ball(subdivisions=4)
        look = Look(
            uv=rng.random((len(mesh.vertices), 2)).astype(np.float32),
            face_material=np.zeros(len(mesh.faces), np.int32),
            base_color=np.full((1, 4), 255, np.uint8),
            material_texture=np.zeros(1, np.int32),
            textures=(texture,),
        )
        seen(renderer, Mesh(mesh.vertices, mesh.faces, look), camera=SCENE.camera.with_resolution(64))

    for _ in range(20):
        one()
    before = resident_megabytes()
    for _ in range(objects):
        one()
    assert resident_megabytes() - before < 30  # the textures of 60 objects kept would be 60

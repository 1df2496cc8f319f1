"""An off-screen OpenGL context made by EGL, with or without a graphics card, and pyrender's renderer in it."""

import os
from contextlib import suppress
from importlib import import_module, resources
from pathlib import Path
from typing import Any

from pipeline.store.temporary import environment

PACKAGES = "libegl1 libgl1 libxrender1 libgl1-mesa-dri"
"""Debian's and Ubuntu's names of the system libraries that headless rendering needs."""

PLATFORM = "PYOPENGL_PLATFORM"
"""The environment variable that tells PyOpenGL, on import, how to find OpenGL's functions."""

SAME_ON_EVERY_PROCESSOR = {"GALLIUM_OVERRIDE_CPU_CAPS": "sse4.1", "LP_NATIVE_VECTOR_WIDTH": "128"}
"""Processor features for Mesa's software renderer: those of every x86-64 processor that numpy supports."""


class NoOpenGL(RuntimeError):
    """Headless OpenGL does not work on this machine; the message names the packages to install."""


def shader_paths() -> list[Path]:
    """List the shaders' source files."""
    return sorted(Path(str(resources.files("pipeline") / "assets" / "shaders")).iterdir())


class OpenGLContext:
    """One OpenGL context with one `pyrender.Renderer` in it; `NoOpenGL` is raised if none can be made.

    pyrender's own `OffscreenRenderer` terminates the whole EGL display when it is deleted, and with it every other
    renderer of the process. This class frees only its own context. `pyrender` is the module; it may be imported only
    while the platform is set.
    """

    def __init__(self, resolution: int) -> None:
        """Open a context for square images of `resolution` pixels per side."""
        try:
            # PyOpenGL reads these on import and Mesa in its first context; the user's platform is kept
            with environment({PLATFORM: os.environ.get(PLATFORM, "egl"), **SAME_ON_EVERY_PROCESSOR}):
                _load_triton()
                import pyrender
                from OpenGL import EGL
                from pyrender.platforms.egl import EGLPlatform

                self._egl = EGL
                self._platform = EGLPlatform(resolution, resolution)
                self._platform.init_context()
                self._platform.make_current()
                self.pyrender = pyrender
                self.renderer = _make_renderer(pyrender, resolution)
        except Exception as error:  # EGL, PyOpenGL and pyrender each fail in their own way, AttributeError among them
            raise NoOpenGL(
                f"headless OpenGL (EGL) does not start: {error!r}. On Debian or Ubuntu: apt-get install {PACKAGES}. "
                "Only render-vision needs it."
            ) from error

    def render(
        self,
        scene: Any,  # a `pyrender.Scene`
        flags: int,  # pyrender's `RenderFlags`
        shape: tuple[int, int],  # rows, columns
        labels: dict[Any, int] | None = None,  # of each node, with the flag SEG
    ) -> Any:
        """Render colours, or the given labels, (R, C, 3) uint8, and depths (R, C) float32, m, 0 for the background."""
        self._platform.make_current()
        self.renderer.viewport_height, self.renderer.viewport_width = shape
        return self.renderer.render(scene, flags | self.pyrender.RenderFlags.OFFSCREEN, labels)

    def close(self) -> None:
        """Free the context."""
        egl, display, context = self._egl, self._platform._egl_display, self._platform._egl_context
        self._platform.make_current()
        self.renderer.delete()
        egl.eglMakeCurrent(display, egl.EGL_NO_SURFACE, egl.EGL_NO_SURFACE, egl.EGL_NO_CONTEXT)
        egl.eglDestroyContext(display, context)
        self._platform._egl_display = self._platform._egl_context = None


def _load_triton() -> None:
    """Load torch's compiler if it is installed: its LLVM and Mesa's share symbols, and only its own work for it."""
    with suppress(ImportError):
        import_module("triton")


def _make_renderer(pyrender: Any, resolution: int) -> Any:
    """Make a `pyrender.Renderer` with the project's shaders that draws nodes in the order of the scene's `nodes_in_order`.

    pyrender's own shaders take three times as long on a CPU and light one side of a face only. It also sorts a set of nodes by
    distance, hence a different one of two coincident faces would win in every process.
    """
    from pyrender.shader_program import ShaderProgramCache

    renderer = pyrender.Renderer(resolution, resolution)
    renderer._program_cache = ShaderProgramCache(shader_dir=str(shader_paths()[0].parent))
    renderer._sorted_mesh_nodes = lambda scene: list(scene.nodes_in_order)
    return renderer

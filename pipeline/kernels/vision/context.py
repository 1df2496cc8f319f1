"""An off-screen OpenGL context by EGL, with or without a graphics card, and pyrender's renderer in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

PACKAGES = "libegl1 libgl1 libxrender1 libgl1-mesa-dri"
"""What Debian and Ubuntu call the system libraries that headless rendering needs."""

PLATFORM = "PYOPENGL_PLATFORM"
"""The environment variable by which PyOpenGL chooses, when it is imported, how to find OpenGL's functions."""


def shader_paths() -> list[Path]:
    """The shaders' source files."""
    return sorted(Path(str(resources.files("pipeline") / "assets" / "shaders")).iterdir())


class NoOpenGL(RuntimeError):
    """Headless OpenGL does not work here; the message says what to install."""


@contextmanager
def _platform() -> Iterator[None]:
    """EGL as PyOpenGL's platform, unless the user chose one, for as long as the imports take."""
    chosen = PLATFORM in os.environ
    os.environ.setdefault(PLATFORM, "egl")
    try:
        yield
    finally:
        if not chosen:
            del os.environ[PLATFORM]


class Context:
    """One OpenGL context and one `pyrender.Renderer` of `resolution` pixels a side in it.

    pyrender's own `OffscreenRenderer` shuts the whole EGL display when it is deleted, and with it every other renderer of the
    process; a context frees what is its own.

    Raises
    ------
    NoOpenGL
        Where no context can be made.
    """

    def __init__(self, resolution: int) -> None:
        """Open the context."""
        try:
            with _platform():
                import pyrender
                from OpenGL import EGL
                from pyrender.platforms.egl import EGLPlatform

                self._egl = EGL
                self._platform = EGLPlatform(resolution, resolution)
                self._platform.init_context()
                self._platform.make_current()
                self.pyrender = pyrender
                self.renderer = _renderer(pyrender, resolution)
        except Exception as error:  # EGL, PyOpenGL and pyrender each fail in their own way, AttributeError among them
            raise NoOpenGL(
                f"headless OpenGL (EGL) does not start: {error!r}. On Debian or Ubuntu: apt-get install {PACKAGES}. "
                "Stages other than render-vision do without."
            ) from error

    def render(self, scene: Any, flags: int, labels: dict[Any, int] | None = None) -> Any:
        """The colours, (R, R, 3) uint8, of a `pyrender.Scene`; with `labels` and the flag SEG each node's number instead."""
        self._platform.make_current()
        color, _ = self.renderer.render(scene, flags | self.pyrender.RenderFlags.OFFSCREEN, labels)
        return color

    def resize(self, resolution: int) -> None:
        """Another number of pixels a side from now on."""
        self.renderer.viewport_width = self.renderer.viewport_height = resolution

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        if self._platform is None:
            return
        egl, display, context = self._egl, self._platform._egl_display, self._platform._egl_context
        self._platform.make_current()
        self.renderer.delete()
        egl.eglMakeCurrent(display, egl.EGL_NO_SURFACE, egl.EGL_NO_SURFACE, egl.EGL_NO_CONTEXT)
        egl.eglDestroyContext(display, context)
        self._platform._egl_display = self._platform._egl_context = None
        self._platform = None


def _renderer(pyrender: Any, resolution: int) -> Any:
    """A `pyrender.Renderer` with the project's shaders, drawing nodes in the order of the scene's `nodes_in_order`.

    pyrender's own shaders cost three times as much on a CPU and light one side of a face only; and it sorts by distance what it takes
    from a set, so of faces that coincide another one would win in every process.
    """
    from pyrender.shader_program import ShaderProgramCache

    class Renderer(pyrender.Renderer):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(resolution, resolution)
            self._program_cache = ShaderProgramCache(shader_dir=str(shader_paths()[0].parent))

        def _sorted_mesh_nodes(self, scene: Any) -> list[Any]:
            return list(scene.nodes_in_order)

    return Renderer()

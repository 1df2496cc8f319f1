"""Off-screen rendering of meshes with pyrender and EGL, with or without a graphics card: one lamp, constant light, segmentation."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module, resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array, Array32
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.vision.camera import Camera, Vector, camera_pose
from pipeline.kernels.vision.primitives import Primitive, mesh_primitives
from pipeline.kernels.vision.scene import Label, Scene
from pipeline.store.temporary import environment

PACKAGES = "libegl1 libgl1 libxrender1 libgl1-mesa-dri"  # Debian's and Ubuntu's names of what headless rendering needs
PLATFORM = "PYOPENGL_PLATFORM"  # the environment variable that tells PyOpenGL, on import, how to find OpenGL's functions
SAME_ON_EVERY_PROCESSOR = {"GALLIUM_OVERRIDE_CPU_CAPS": "sse4.1", "LP_NATIVE_VECTOR_WIDTH": "128"}
"""Processor features for Mesa's software renderer: those of every x86-64 processor that numpy supports."""
NEAR_PLANE, FAR_PLANE = 0.05, 20.0  # m from the camera, between which surfaces are drawn: enough for a hand and an object
CLOSE_PLANE = 0.005  # m, in place of `NEAR_PLANE` where a mesh comes nearer, as to a camera at the wrist; depths are a tenth as exact
REACH = 10.0  # m from the world's origin, within which a camera farther away draws all surfaces


class Surface(NamedTuple):
    """Triangles of one material in OpenGL's memory: pyrender's primitive, and its programs that draw it in colours and as a label."""

    primitive: Any
    in_color: Any
    as_label: Any


@dataclass(frozen=True, eq=False)
class MeshHandle:
    """A mesh that was added to a renderer."""

    surfaces: list[Surface]
    label: Label
    bounds: Array  # (2, 3) m, of its corners in its own frame: least, greatest; infinite where it has none


PosedMesh = tuple[MeshHandle, Array]  # a mesh that was added to a renderer, and its pose, (4, 4) to the world frame


class NoOpenGL(RuntimeError):
    """Headless OpenGL does not work on this machine; the message names the packages to install."""


def shader_paths() -> list[Path]:
    """List the shaders' source files."""
    return sorted(Path(str(resources.files("pipeline") / "assets" / "shaders")).iterdir())


class OpenGLContext:
    """One OpenGL context with pyrender's framebuffers and programs in it; `NoOpenGL` is raised if none can be made.

    pyrender's own `OffscreenRenderer` terminates the whole EGL display when it is deleted, and with it every other renderer of the process.
    This class frees only its own context. `pyrender` and `gl` are modules; they may be imported only while the platform is set.
    """

    def __init__(self, resolution: int) -> None:
        try:
            # PyOpenGL reads these on import and Mesa in its first context; the user's platform is kept
            with environment({PLATFORM: os.environ.get(PLATFORM, "egl"), **SAME_ON_EVERY_PROCESSOR}):
                with suppress(ImportError):  # torch's compiler first: its LLVM and Mesa's share symbols, and only its own work for it
                    import_module("triton")
                import pyrender
                from OpenGL import EGL, GL
                from pyrender.platforms.egl import EGLPlatform
                from pyrender.shader_program import ShaderProgramCache

                self._egl = EGL
                self._platform = EGLPlatform(resolution, resolution)
                self._platform.init_context()
                self._platform.make_current()
                self.pyrender, self.gl = pyrender, GL
                self._renderer = pyrender.Renderer(resolution, resolution)
                # pyrender's own shaders take three times as long on a CPU and light one side of a face only
                self._renderer._program_cache = ShaderProgramCache(shader_dir=str(shader_paths()[0].parent))
                self._place = cache(GL.glGetUniformLocation)
        except Exception as error:  # EGL, PyOpenGL and pyrender each fail in their own way, AttributeError among them
            raise NoOpenGL(
                f"headless OpenGL (EGL), which render-vision alone needs, does not start: {error!r}; on Debian or Ubuntu, "
                f"apt-get install {PACKAGES}"
            ) from error

    def upload(self, primitive: Primitive) -> Surface:
        """Bring triangles into OpenGL's memory, and link the programs that draw them."""
        self.make_current()
        drawn, flags = _gl_primitive(self.pyrender, primitive), self.pyrender.RenderFlags
        drawn._add_to_context()
        for texture in drawn.material.textures:
            texture._add_to_context()
        use = self.pyrender.constants.ProgramFlags.USE_MATERIAL
        return Surface(drawn, *(self._renderer._get_primitive_program(drawn, kind, use) for kind in (flags.NONE, flags.SEG)))

    def free(self, surface: Surface) -> None:
        """Free the buffers and the texture of a surface."""
        self.make_current()
        for of_opengl in (surface.primitive, *surface.primitive.material.textures):
            of_opengl.delete()

    def make_current(self) -> None:
        """Let OpenGL's functions work in this context."""
        self._platform.make_current()

    def draw(
        self,
        meshes: Iterable[PosedMesh],  # in this order: the first of two coincident faces shows
        values: Mapping[str, Array32],  # of uniforms
        background: Vector,
        shape: tuple[int, int],  # rows, columns
        *,
        as_labels: bool,  # at pixels' centres, instead of colours with four samples per pixel
    ) -> None:
        """Draw meshes into the framebuffer that is read: pyrender's buffers and programs without its scene, whose Python takes longer."""
        gl, renderer, program = self.gl, self._renderer, None
        self.make_current()
        renderer.viewport_height, renderer.viewport_width = shape
        renderer._configure_forward_pass_viewport(self.pyrender.RenderFlags.OFFSCREEN)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, renderer._main_fb if as_labels else renderer._main_fb_ms)
        gl.glEnable(gl.GL_CULL_FACE)
        gl.glClearColor(*background, 1.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        for handle, pose in meshes:
            for surface in handle.surfaces:
                if program is not (wanted := surface.as_label if as_labels else surface.in_color):
                    program = wanted
                    program._bind()
                    self._set(program, values)
                material = surface.primitive.material
                label, color = np.full(3, handle.label / 255), material.baseColorFactor
                self._set(program, {"M": pose, "color": label, "material.base_color_factor": color})
                for texture in material.textures:
                    texture._bind()
                gl.glBindVertexArray(surface.primitive._vaid)
                gl.glDrawElements(gl.GL_TRIANGLES, surface.primitive.indices.size, gl.GL_UNSIGNED_INT, None)
        if not as_labels:
            gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, renderer._main_fb)
            gl.glBlitFramebuffer(*2 * (0, 0, *shape[::-1]), gl.GL_COLOR_BUFFER_BIT, gl.GL_LINEAR)
            gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, renderer._main_fb)

    def _set(self, program: Any, values: Mapping[str, Array | Array32]) -> None:  # (1,), (3,), (4,) or (4, 4)
        """Set uniforms, those that the program has."""
        for name, value in values.items():
            place, numbers = self._place(program._program_id, name), value.astype(np.float32)
            if place >= 0 and value.ndim == 2:
                self.gl.glUniformMatrix4fv(place, 1, self.gl.GL_TRUE, numbers)
            elif place >= 0:
                getattr(self.gl, f"glUniform{len(value)}fv")(place, 1, numbers)

    def read_colors(self, shape: tuple[int, int]) -> NDArray[np.uint8]:  # (R, C, 4)
        """Read what was drawn, the top row first."""
        pixels = self.gl.glReadPixels(0, 0, *shape[::-1], self.gl.GL_RGBA, self.gl.GL_UNSIGNED_BYTE)
        return np.frombuffer(pixels, np.uint8).reshape(*shape, 4)[::-1]

    def read_depth(self, shape: tuple[int, int], near: float, far: float) -> Array32:  # (R, C) m
        """Read the depths of what was drawn as labels; those of the background mean nothing."""
        pixels = self.gl.glReadPixels(0, 0, *shape[::-1], self.gl.GL_DEPTH_COMPONENT, self.gl.GL_FLOAT)
        depth = 2 * np.frombuffer(pixels, np.float32).reshape(shape)[::-1] - 1
        return (2 * near * far) / (far + near - depth * (far - near))

    def close(self) -> None:
        """Free the context."""
        egl, display, context = self._egl, self._platform._egl_display, self._platform._egl_context
        self.make_current()
        self._renderer.delete()
        egl.eglMakeCurrent(display, egl.EGL_NO_SURFACE, egl.EGL_NO_SURFACE, egl.EGL_NO_CONTEXT)
        egl.eglDestroyContext(display, context)
        self._platform._egl_display = self._platform._egl_context = None


@dataclass(frozen=True)
class RenderedImage:
    """An image and its segmentation."""

    rgb: NDArray[np.uint8]  # (R, C, 3) sRGB, antialiased
    segmentation: NDArray[np.uint8]  # (R, C) `Label` of the surface that the ray through the pixel's centre meets first
    depth: Array32  # (R, C) m, of that surface along the viewing direction; +inf for the background


class Renderer(AbstractContextManager["Renderer"]):
    """Renders meshes in a scene.

    Use it as a context manager: OpenGL frees nothing by itself. Several renderers in one process do not disturb each other. The same calls
    give the same bytes in every process of one machine. Images have `resolution` pixels per side, with which the camera's intrinsics scale.
    """

    def __init__(self, scene: Scene, resolution: int = 256) -> None:
        self._camera, self._lamp_position = scene.camera.with_resolution(resolution), scene.lamp.position
        self._background, lamp = scene.background, scene.lamp
        self._light = {"ambient_light": scene.ambient, "point_lights[0].color": lamp.color, "point_lights[0].intensity": [lamp.intensity]}
        self._context = OpenGLContext(resolution)

    def __exit__(self, *_: object) -> None:
        self._context.close()

    def add(self, mesh: Mesh, label: Label) -> MeshHandle:
        """Add a mesh; an image shows it when `render` is given its handle."""
        primitives = mesh_primitives(mesh)
        corners = np.concatenate([np.zeros((0, 3), np.float32), *(primitive.positions for primitive in primitives)]).astype(np.float64)
        bounds = np.stack([corners.min(axis=0, initial=np.inf), corners.max(axis=0, initial=-np.inf)])
        return MeshHandle([self._context.upload(primitive) for primitive in primitives], label, bounds)

    def remove(self, handle: MeshHandle) -> None:
        """Remove a mesh; its buffers and textures are freed."""
        for surface in handle.surfaces:
            self._context.free(surface)

    @contextmanager
    def added(self, mesh: Mesh, label: Label) -> Iterator[MeshHandle]:
        """Add a mesh for as long as the context lasts."""
        handle = self.add(mesh, label)
        try:
            yield handle
        finally:
            self.remove(handle)

    def render(
        self,
        meshes: Sequence[PosedMesh],  # handles, each with its pose (4, 4) in the world
        camera: Camera | None = None,  # replaces the scene's; its shape is the image's
        lamp: Vector | None = None,  # replaces the position of the scene's lamp, world frame, m
    ) -> RenderedImage:
        """Render only the given meshes."""
        camera = camera or self._camera
        (lens, uniforms), shape = self._view(meshes, camera, lamp), camera.shape
        self._context.draw(meshes, uniforms, self._background, shape, as_labels=False)
        rgb = np.ascontiguousarray(self._context.read_colors(shape)[..., :3])
        self._context.draw(meshes, uniforms, (0.0, 0.0, 0.0), shape, as_labels=True)
        segmentation = np.ascontiguousarray(self._context.read_colors(shape)[..., 0])
        depth = self._context.read_depth(shape, lens.znear, lens.zfar)
        return RenderedImage(rgb, segmentation, np.where(segmentation == Label.BACKGROUND, np.float32(np.inf), depth))

    def render_colors(self, meshes: Sequence[PosedMesh], camera: Camera | None = None, lamp: Vector | None = None) -> NDArray[np.uint8]:
        """Render the colours that `render` gives, (R, C, 3), in half the time."""
        camera = camera or self._camera
        self._context.draw(meshes, self._view(meshes, camera, lamp)[1], self._background, camera.shape, as_labels=False)
        return np.ascontiguousarray(self._context.read_colors(camera.shape)[..., :3])

    def _view(self, meshes: Sequence[PosedMesh], camera: Camera, lamp: Vector | None) -> tuple[Any, dict[str, Array32]]:
        """Compute pyrender's camera, and the uniforms of drawings."""
        pose, shape = camera_pose(camera), camera.shape
        (fx, fy), (cx, cy), away = camera.focal, camera.centre, float(length(camera.position))
        near = max(float(np.clip(_least_depth(meshes, pose), CLOSE_PLANE, NEAR_PLANE)), away - REACH)
        lens = self._context.pyrender.IntrinsicsCamera(fx=fx, fy=fy, cx=cx, cy=cy, znear=near, zfar=max(FAR_PLANE, away + REACH))
        values = {
            "V": np.linalg.inv(pose),
            "P": lens.get_projection_matrix(width=shape[1], height=shape[0]),
            "cam_pos": pose[:3, 3],
            "point_lights[0].position": lamp or self._lamp_position,
            **self._light,
        }
        return lens, {name: np.asarray(value, np.float32) for name, value in values.items()}


def _least_depth(meshes: Sequence[PosedMesh], pose_of_camera: Array) -> float:
    """Compute the least depth of the boxes around meshes, m, from a camera's pose (4, 4); +inf without meshes."""
    backwards, position, least = pose_of_camera[:3, 2], pose_of_camera[:3, 3], np.inf
    for handle, pose in meshes:
        if not handle.surfaces:
            continue
        low, high = handle.bounds
        middle, half = pose[:3, :3] @ (low + high) / 2 + pose[:3, 3], np.abs(backwards @ pose[:3, :3]) @ (high - low) / 2
        least = min(least, float((position - middle) @ backwards - half))
    return least


def _gl_primitive(gl: Any, primitive: Primitive) -> Any:
    # RGBA although opaque: OpenGL pads rows of RGB to four bytes, which shears images of odd width.
    texture = None if primitive.texture is None else gl.Texture(source=primitive.texture, source_channels="RGBA")
    material = gl.MetallicRoughnessMaterial(
        baseColorFactor=np.array([*primitive.color, 1.0]),
        baseColorTexture=texture,
        alphaMode="OPAQUE",
        doubleSided=False,  # every face is present twice, once for each side
    )
    return gl.Primitive(
        positions=primitive.positions,
        normals=primitive.normals,
        texcoord_0=primitive.uv if texture is not None else None,
        color_0=primitive.vertex_color,
        indices=primitive.indices,
        material=material,
    )

"""Off-screen rendering of meshes with pyrender and EGL, with or without a graphics card: one lamp, constant light, segmentation."""

import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module, resources
from pathlib import Path
from typing import Any

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

MeshHandle = Any
"""A mesh that was added to a renderer: its node in pyrender's scene."""
PosedMesh = tuple[MeshHandle, Array]
"""A mesh that was added to a renderer, and its pose, (4, 4) to the world frame."""


class NoOpenGL(RuntimeError):
    """Headless OpenGL does not work on this machine; the message names the packages to install."""


def shader_paths() -> list[Path]:
    """List the shaders' source files."""
    return sorted(Path(str(resources.files("pipeline") / "assets" / "shaders")).iterdir())


class OpenGLContext:
    """One OpenGL context with one `pyrender.Renderer` in it; `NoOpenGL` is raised if none can be made.

    pyrender's own `OffscreenRenderer` terminates the whole EGL display when it is deleted, and with it every other renderer of the process.
    This class frees only its own context. `pyrender` is the module; it may be imported only while the platform is set.
    """

    def __init__(self, resolution: int) -> None:
        try:
            # PyOpenGL reads these on import and Mesa in its first context; the user's platform is kept
            with environment({PLATFORM: os.environ.get(PLATFORM, "egl"), **SAME_ON_EVERY_PROCESSOR}):
                with suppress(ImportError):  # torch's compiler first: its LLVM and Mesa's share symbols, and only its own work for it
                    import_module("triton")
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
        self._context = OpenGLContext(resolution)
        self._gl = self._context.pyrender
        self._scene = self._gl.Scene(bg_color=np.array([*scene.background, 1.0]), ambient_light=np.array(scene.ambient))
        self._labels: dict[Any, int] = {}
        self._camera_node = self._scene.add(_gl_camera(self._gl, self._camera))
        self._lamp_node = self._scene.add(self._gl.PointLight(color=np.array(scene.lamp.color), intensity=scene.lamp.intensity))

    def __exit__(self, *_: object) -> None:
        self._context.close()

    def add(self, mesh: Mesh, label: Label) -> MeshHandle:
        """Add a mesh; an image shows it when `render` is given its handle."""
        node = self._scene.add(self._gl.Mesh([_gl_primitive(self._gl, primitive) for primitive in mesh_primitives(mesh)]))
        self._labels[node] = int(label)
        return node

    def remove(self, handle: MeshHandle) -> None:
        """Remove a mesh; its buffers and textures are freed when the next image is rendered."""
        del self._labels[handle]
        self._scene.remove_node(handle)

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
        pose_of_camera, lamp_pose = camera_pose(camera), np.eye(4)
        self._camera_node.camera = _gl_camera(self._gl, camera, _least_depth(meshes, pose_of_camera))
        self._scene.set_pose(self._camera_node, pose_of_camera)
        lamp_pose[:3, 3] = lamp or self._lamp_position
        self._scene.set_pose(self._lamp_node, lamp_pose)
        for node in self._labels:
            node.mesh.is_visible = False
        for handle, pose in meshes:
            handle.mesh.is_visible = True
            self._scene.set_pose(handle, pose)
        self._scene.nodes_in_order = [handle for handle, _ in meshes]
        rgb, _ = self._context.render(self._scene, self._gl.RenderFlags.NONE, camera.shape)
        labels, depth = self._context.render(self._scene, self._gl.RenderFlags.SEG, camera.shape, self._labels)
        segmentation = np.ascontiguousarray(labels[..., 0], np.uint8)
        depth = np.where(segmentation == Label.BACKGROUND, np.float32(np.inf), depth).astype(np.float32)
        return RenderedImage(np.ascontiguousarray(rgb, np.uint8), segmentation, depth)


def _least_depth(meshes: Sequence[PosedMesh], pose_of_camera: Array) -> float:
    """Compute the least depth of the boxes around meshes, m, from a camera's pose (4, 4); +inf without meshes."""
    backwards, position, least = pose_of_camera[:3, 2], pose_of_camera[:3, 3], np.inf
    for handle, pose in meshes:
        if not handle.mesh.primitives:
            continue
        low, high = handle.mesh.bounds
        middle, half = pose[:3, :3] @ (low + high) / 2 + pose[:3, 3], np.abs(backwards @ pose[:3, :3]) @ (high - low) / 2
        least = min(least, float((position - middle) @ backwards - half))
    return least


def _gl_camera(gl: Any, camera: Camera, least_depth: float = np.inf) -> Any:
    (fx, fy), (cx, cy), away = camera.focal, camera.centre, float(length(camera.position))
    near, far = max(float(np.clip(least_depth, CLOSE_PLANE, NEAR_PLANE)), away - REACH), max(FAR_PLANE, away + REACH)
    return gl.IntrinsicsCamera(fx=fx, fy=fy, cx=cx, cy=cy, znear=near, zfar=far)


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

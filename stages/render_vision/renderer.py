"""Off-screen rendering of meshes with pyrender: one lamp, constant light, segmentation."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.vision.camera import Camera, Vector, camera_pose
from pipeline.kernels.vision.primitives import Primitive, mesh_primitives
from pipeline.kernels.vision.scene import Label, Scene
from stages.render_vision.opengl_context import OpenGLContext

NEAR_PLANE, FAR_PLANE = 0.05, 20.0
"""Surfaces between these distances from the camera are drawn, m: enough for a hand and an object a metre away."""
CLOSE_PLANE = 0.005
"""In place of `NEAR_PLANE` where a mesh comes nearer to the camera, as to one at the wrist, m; depths are then a tenth as exact."""
REACH = 10.0
"""Distance from the world's origin within which a camera farther away draws all surfaces, m."""


@dataclass(frozen=True)
class RenderedImage:
    """An image and its segmentation."""

    rgb: NDArray[np.uint8]  # (R, C, 3) sRGB, antialiased
    segmentation: NDArray[np.uint8]  # (R, C) `Label` of the surface that the ray through the pixel's centre meets first
    depth: NDArray[np.float32]  # (R, C) m, of that surface along the viewing direction; +inf for the background


MeshHandle = Any
"""A mesh that was added to a renderer: its node in pyrender's scene."""

PosedMesh = tuple[MeshHandle, NDArray[np.float64]]
"""A mesh that was added to a renderer, and its pose, (4, 4) to the world frame."""


class Renderer(AbstractContextManager["Renderer"]):
    """Renders meshes in a scene.

    Use it as a context manager: OpenGL frees nothing by itself. Several renderers in one process do not disturb each
    other. The same calls give the same bytes in every process of one machine.

    Images have `resolution` pixels per side, with which the camera's intrinsics scale. `NoOpenGL` is raised if headless
    OpenGL does not work; it names the packages to install.
    """

    def __init__(self, scene: Scene, resolution: int = 256) -> None:
        """Open an OpenGL context and set up the scene without meshes."""
        self._camera, self._lamp_position = scene.camera.with_resolution(resolution), scene.lamp.position
        self._context = OpenGLContext(resolution)
        self._gl = self._context.pyrender
        self._scene = self._gl.Scene(bg_color=np.array([*scene.background, 1.0]), ambient_light=np.array(scene.ambient))
        self._labels: dict[Any, int] = {}
        self._camera_node = self._scene.add(_gl_camera(self._gl, self._camera))
        self._lamp_node = self._scene.add(self._gl.PointLight(color=np.array(scene.lamp.color), intensity=scene.lamp.intensity))

    def __exit__(self, *_: object) -> None:
        """Free the context and everything in it."""
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
        self._place(meshes, camera, lamp or self._lamp_position)
        rgb, _ = self._context.render(self._scene, self._gl.RenderFlags.NONE, camera.shape)
        segmentation, depth = self._segment(camera)
        depth = np.where(segmentation == Label.BACKGROUND, np.float32(np.inf), depth).astype(np.float32)
        return RenderedImage(np.ascontiguousarray(rgb, np.uint8), segmentation, depth)

    def segment(self, meshes: Sequence[PosedMesh], camera: Camera) -> NDArray[np.uint8]:
        """Render the labels of the given meshes alone, (rows, cols): half the work of an image."""
        self._place(meshes, camera, self._lamp_position)
        return self._segment(camera)[0]

    def _segment(self, camera: Camera) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        labels, depth = self._context.render(self._scene, self._gl.RenderFlags.SEG, camera.shape, self._labels)
        return np.ascontiguousarray(labels[..., 0], np.uint8), depth

    def _place(self, meshes: Sequence[PosedMesh], camera: Camera, lamp: Vector) -> None:
        """Show only the given meshes, where they are posed, to a camera."""
        pose_of_camera = camera_pose(camera)
        self._camera_node.camera = _gl_camera(self._gl, camera, _least_depth(meshes, pose_of_camera))
        self._scene.set_pose(self._camera_node, pose_of_camera)
        lamp_pose = np.eye(4)
        lamp_pose[:3, 3] = lamp
        self._scene.set_pose(self._lamp_node, lamp_pose)
        for node in self._labels:
            node.mesh.is_visible = False
        for handle, pose in meshes:
            handle.mesh.is_visible = True
            self._scene.set_pose(handle, pose)
        self._scene.nodes_in_order = [handle for handle, _ in meshes]


def _least_depth(meshes: Sequence[PosedMesh], pose_of_camera: NDArray[np.float64]) -> float:
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

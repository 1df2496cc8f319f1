"""The project's renderer: pyrender on OpenGL, off screen, one lamp and constant light."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.vision.camera import Camera, Vector, pose
from pipeline.kernels.vision.context import Context
from pipeline.kernels.vision.primitives import primitives
from pipeline.kernels.vision.scene import Scene
from pipeline.kernels.vision.view import Label, Part, Placed, View

NEAR, FAR = 0.05, 20.0
"""What lies between these distances from the camera is drawn, m: well around a hand and an object a metre away."""


class RasterRenderer:
    """Makes images of meshes in a scene (a `Renderer`). Use it as a context manager, or `close` it: OpenGL frees nothing by itself.

    Two renderers in one process do not disturb each other. The same calls give the same bytes in every process of one machine.

    Parameters
    ----------
    scene
        Camera, lamp, constant light and background.
    resolution
        Pixels a side; the camera's intrinsics scale with it.

    Raises
    ------
    NoOpenGL
        Where headless OpenGL does not work; the message names the packages to install.
    """

    def __init__(self, scene: Scene, resolution: int = 256) -> None:
        """Open an OpenGL context and set up the scene in it, still empty."""
        self.camera = scene.camera.at(resolution)
        self._context = Context(resolution)
        self._gl = self._context.pyrender
        self._scene = self._gl.Scene(bg_color=np.array([*scene.background, 1.0]), ambient_light=np.array(scene.ambient))
        self._nodes: dict[int, Any] = {}
        self._labels: dict[Any, int] = {}
        self._count = 0
        self._eye = self._scene.add(_lens(self._gl, self.camera), pose=pose(self.camera))
        self.lamp = scene.lamp.position
        self._lamp = self._scene.add(self._gl.PointLight(color=np.array(scene.lamp.color), intensity=scene.lamp.intensity))

    def __enter__(self) -> RasterRenderer:
        """The renderer itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close it, whatever happened."""
        self.close()

    def close(self) -> None:
        """Free the context and all that was added to it."""
        self._context.close()

    def add(self, mesh: Mesh, label: Label) -> Part:
        """Take a mesh in; it is in no image until `render` names it."""
        drawn = self._gl.Mesh([_primitive(self._gl, part) for part in primitives(mesh)])
        node = self._scene.add(drawn)
        self._count += 1
        self._nodes[self._count] = node
        self._labels[node] = int(label)
        return Part(self._count)

    def remove(self, part: Part) -> None:
        """Forget a mesh; its buffers and textures are freed when the next image is made."""
        node = self._nodes.pop(part.number)
        del self._labels[node]
        self._scene.remove_node(node)

    def render(self, parts: Sequence[Placed], camera: Camera | None = None, lamp: Vector | None = None) -> View:
        """An image of these parts and nothing else, by the scene's camera or another one.

        Parameters
        ----------
        parts
            Which parts, and the frame (4, 4) of each in the world.
        camera
            Looks instead of the scene's; its resolution is the image's.
        lamp
            Where the lamp stands instead of the scene's place, world, m.
        """
        camera = camera or self.camera
        self._eye.camera = _lens(self._gl, camera)
        self._scene.set_pose(self._eye, pose(camera))
        self._scene.set_pose(self._lamp, _moved(lamp or self.lamp))
        self._context.resize(camera.resolution)
        for node in self._nodes.values():
            node.mesh.is_visible = False
        for part, frame in parts:
            node = self._nodes[part.number]
            node.mesh.is_visible = True
            self._scene.set_pose(node, frame)
        self._scene.nodes_in_order = [self._nodes[part.number] for part, _ in parts]
        flags = self._gl.RenderFlags
        rgb = self._context.render(self._scene, flags.NONE)
        segmentation = self._context.render(self._scene, flags.SEG, self._labels)[..., 0]
        return View(_own(rgb), _own(segmentation))


def _moved(position: Vector) -> NDArray[np.float64]:
    frame = np.eye(4)
    frame[:3, 3] = position
    return frame


def _own(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(image, np.uint8)


def _lens(gl: Any, camera: Camera) -> Any:
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    return gl.IntrinsicsCamera(fx=fx, fy=fy, cx=cx, cy=cy, znear=NEAR, zfar=FAR)


def _primitive(gl: Any, part: Any) -> Any:
    texture = None
    if part.texture is not None:
        # RGBA although opaque: OpenGL pads rows of RGB to four bytes, which shears images of odd width.
        texture = gl.Texture(source=part.texture, source_channels="RGBA")
    material = gl.MetallicRoughnessMaterial(
        baseColorFactor=np.array([*part.color, 1.0]),
        baseColorTexture=texture,
        alphaMode="OPAQUE",
        doubleSided=False,  # every face is there twice, once for each side
    )
    return gl.Primitive(
        positions=part.positions,
        normals=part.normals,
        texcoord_0=part.uv if texture is not None else None,
        indices=part.indices,
        material=material,
    )

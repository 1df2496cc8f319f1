"""What a depth-only rasteriser gives of a sensor: pyrender with a perspective camera, and bare OpenGL with parallel rays.

Both by EGL, on a graphics card or, without one, by Mesa in software. Depths are in the sensor's frame, m from the sensor plane along its
normal, +inf where nothing is drawn, (rows, cols) float64.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.sensor import Sensor
from stages.render_vision.opengl_context import OpenGLContext

TO_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
"""An OpenGL camera looks along its -z with +y up; a sensor looks along +z and its rows go along +y."""


class PerspectiveRasteriser:
    """pyrender's depth-only pass, by a pinhole camera whose view covers the sensor's square at the gel's face, z = w.

    The pass draws no face that is seen from behind, whatever a material says.

    Parameters
    ----------
    context
        Is current; only one may be while rasterisers are in use.
    eye
        m from the eye to the gel's face. The farther, the more nearly parallel the rays.
    """

    def __init__(self, context: OpenGLContext, mesh: Mesh, sensor: Sensor, eye: float) -> None:
        self._sensor, self._eye = sensor, eye
        pyrender = context.pyrender
        self._flags = pyrender.RenderFlags.DEPTH_ONLY | pyrender.RenderFlags.OFFSCREEN
        self._renderer = pyrender.Renderer(sensor.cols, sensor.rows)
        self._scene = pyrender.Scene()
        primitive = pyrender.Primitive(positions=mesh.vertices.astype(np.float32), indices=mesh.faces)
        self._scene.add(pyrender.Mesh([primitive]))
        lens = pyrender.PerspectiveCamera(
            yfov=2 * np.arctan(sensor.width / 2 / eye),
            znear=eye - sensor.w,
            zfar=eye - sensor.w + sensor.range,
            aspectRatio=1.0,
        )
        self._camera = self._scene.add(lens)

    def eye_depth(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of each pixel's surface from the eye, along the axis, m; +inf where nothing is drawn."""
        behind = np.eye(4)
        behind[2, 3] = self._sensor.w - self._eye
        self._scene.set_pose(self._camera, pose @ behind @ TO_CAMERA)
        depth = self._renderer.render(self._scene, self._flags).astype(np.float64)
        depth[depth == 0] = np.inf
        return depth

    def depth(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """What it takes for the sensor's depth map: pixel by pixel, its rays' not being parallel overlooked."""
        depth = self.eye_depth(pose) - (self._eye - self._sensor.w)
        return np.where(depth >= 0, depth, np.inf)


class ParallelRasteriser:
    """One draw call with an orthographic projection, into a float32 depth buffer without multisampling: the least there is to do."""

    VERTEX = "#version 330 core\nlayout(location = 0) in vec3 p; uniform mat4 view; void main() { gl_Position = view * vec4(p, 1.0); }"
    FRAGMENT = "#version 330 core\nvoid main() {}"

    def __init__(self, context: OpenGLContext, mesh: Mesh, sensor: Sensor) -> None:
        from OpenGL import GL  # not sooner: the context says which OpenGL it is

        self._context, self._gl, self._sensor = context, GL, sensor
        self._program = _program(GL, self.VERTEX, self.FRAGMENT)
        self._view = GL.glGetUniformLocation(self._program, "view")
        self._middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2  # float32 is finest around 0
        self._count = mesh.faces.size
        self._array = GL.glGenVertexArrays(1)
        GL.glBindVertexArray(self._array)
        _fill(GL, GL.GL_ARRAY_BUFFER, (mesh.vertices - self._middle).astype(np.float32))
        GL.glEnableVertexAttribArray(0)
        GL.glVertexAttribPointer(0, 3, GL.GL_FLOAT, False, 0, ctypes.c_void_p(0))
        _fill(GL, GL.GL_ELEMENT_ARRAY_BUFFER, mesh.faces.astype(np.uint32))
        self._frame = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._frame)
        buffer = GL.glGenRenderbuffers(1)
        GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
        GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, GL.GL_DEPTH_COMPONENT32F, sensor.cols, sensor.rows)
        GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_RENDERBUFFER, buffer)
        GL.glDrawBuffer(GL.GL_NONE)
        GL.glReadBuffer(GL.GL_NONE)

    def depth(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The sensor's depth map: first surface along parallel rays through the pixels' centres."""
        sensor, GL = self._sensor, self._gl
        GL.glUseProgram(self._program)
        GL.glBindVertexArray(self._array)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._frame)
        GL.glViewport(0, 0, sensor.cols, sensor.rows)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glClear(GL.GL_DEPTH_BUFFER_BIT)
        GL.glUniformMatrix4fv(self._view, 1, True, self._projection(pose).astype(np.float32))
        GL.glDrawElements(GL.GL_TRIANGLES, self._count, GL.GL_UNSIGNED_INT, ctypes.c_void_p(0))
        pixels = GL.glReadPixels(0, 0, sensor.cols, sensor.rows, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT)
        depth = np.frombuffer(pixels, np.float32).reshape(sensor.shape).astype(np.float64)
        return np.where(depth < 1, depth * sensor.range, np.inf)

    def _projection(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """World (from the mesh's middle) to the cube of side 2 that OpenGL draws: square and range of the sensor."""
        to_sensor = np.eye(4)
        to_sensor[:3, :3] = pose[:3, :3].T
        to_sensor[:3, 3] = pose[:3, :3].T @ (self._middle - pose[:3, 3])
        half = self._sensor.width / 2
        to_sensor[:3] /= np.array([half, half, self._sensor.range / 2])[:, None]
        to_sensor[2, 3] -= 1
        return to_sensor


def _program(GL: Any, vertex: str, fragment: str) -> Any:
    program = GL.glCreateProgram()
    for kind, source in ((GL.GL_VERTEX_SHADER, vertex), (GL.GL_FRAGMENT_SHADER, fragment)):
        shader = GL.glCreateShader(kind)
        GL.glShaderSource(shader, source)
        GL.glCompileShader(shader)
        if not GL.glGetShaderiv(shader, GL.GL_COMPILE_STATUS):
            raise RuntimeError(f"OpenGL does not compile a shader: {GL.glGetShaderInfoLog(shader)!r}")
        GL.glAttachShader(program, shader)
    GL.glLinkProgram(program)
    return program


def _fill(GL: Any, target: Any, values: NDArray[Any]) -> None:
    values = np.ascontiguousarray(values)
    GL.glBindBuffer(target, GL.glGenBuffers(1))
    GL.glBufferData(target, values.nbytes, values, GL.GL_STATIC_DRAW)

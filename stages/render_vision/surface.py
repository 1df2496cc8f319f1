"""Triangles of one material in OpenGL's memory: uploaded by pyrender, drawn without its scene, whose Python takes longer than OpenGL."""

from collections.abc import Mapping
from functools import cache, partial
from typing import Any

import numpy as np

from pipeline.kernels.arrays import Array32


class Shader:
    """A program that pyrender has linked; OpenGL is asked once for the place of each uniform."""

    def __init__(self, gl: Any, program: Any) -> None:
        self._gl, self._program = gl, program
        self._place = cache(partial(gl.glGetUniformLocation, program._program_id))

    def use(self, values: Mapping[str, Array32]) -> None:
        """Draw with this program, and with values that are the same for all surfaces of an image."""
        self._program._bind()
        for name, value in values.items():
            self.set(name, value)

    def set(self, name: str, value: Array32) -> None:  # (1,), (3,), (4,) or (4, 4)
        """Set a uniform, if the program has it."""
        place = self._place(name)
        if place < 0:
            return
        if value.ndim == 2:
            self._gl.glUniformMatrix4fv(place, 1, self._gl.GL_TRUE, value)
        else:
            getattr(self._gl, f"glUniform{len(value)}fv")(place, 1, value)


class Surface:
    """A primitive that is in OpenGL's memory until `delete`, with the programs that draw it in its colours and as a label."""

    def __init__(self, gl: Any, primitive: Any, in_color: Shader, as_label: Shader) -> None:
        self._gl, self._primitive, self.in_color, self.as_label = gl, primitive, in_color, as_label
        self._texture = primitive.material.baseColorTexture
        self._color = np.asarray(primitive.material.baseColorFactor, np.float32)
        primitive._add_to_context()
        if self._texture is not None:
            self._texture._add_to_context()

    def draw(self, shader: Shader) -> None:
        """Draw it with the program in use, which is one of its own."""
        shader.set("material.base_color_factor", self._color)
        if self._texture is not None:
            self._texture._bind()
        self._gl.glBindVertexArray(self._primitive._vaid)
        self._gl.glDrawElements(self._gl.GL_TRIANGLES, self._primitive.indices.size, self._gl.GL_UNSIGNED_INT, None)

    def delete(self) -> None:
        """Free its buffers and its texture."""
        self._primitive.delete()
        if self._texture is not None:
            self._texture.delete()

"""A triangle mesh and its look, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Look:
    """What a mesh looks like: one material a face, each a base colour and perhaps a texture.

    Attributes
    ----------
    uv
        (V, 2) float32, texture coordinates of every vertex, v upwards; zeros where no material has a texture.
    face_material
        (F,) int32, the row of `base_color` that paints each face.
    base_color
        (M, 4) uint8, sRGB and opacity of every material; it multiplies the texture where there is one.
    material_texture
        (M,) int32, the entry of `textures` that each material wears, -1 for none.
    textures
        Images, each (height, width, 4) uint8, sRGB and opacity, first row at the top.
    """

    uv: NDArray[np.float32]
    face_material: NDArray[np.int32]
    base_color: NDArray[np.uint8]
    material_texture: NDArray[np.int32]
    textures: tuple[NDArray[np.uint8], ...] = ()

    @staticmethod
    def plain(vertices: int, faces: int, color: tuple[int, int, int] = (178, 178, 178)) -> Look:
        """One opaque colour for a mesh of so many vertices and faces."""
        return Look(
            uv=np.zeros((vertices, 2), np.float32),
            face_material=np.zeros(faces, np.int32),
            base_color=np.array([[*color, 255]], np.uint8),
            material_texture=np.array([-1], np.int32),
        )


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh: `vertices` (V, 3) float64 in metres, `faces` (F, 3) int32, and its `look`."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    look: Look

    @staticmethod
    def bare(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
        """A mesh of the given shape in plain grey."""
        return Mesh(
            np.ascontiguousarray(vertices, np.float64),
            np.ascontiguousarray(faces, np.int32),
            Look.plain(len(vertices), len(faces)),
        )

    @property
    def triangles(self) -> NDArray[np.float64]:
        """(F, 3, 3) corner positions of every face, m."""
        return self.vertices[self.faces]


def face_cross_products(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 3) cross products of two edges: along the winding normal, twice the face's area long, m².

    Right to 4 units in the last place of the product of those edges' lengths, wherever the face is.
    """
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def flatness(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F,) height of every face (F, 3, 3) over its longest edge, 1/aspect: 0.87 for equal sides, 0 for no area; of any size."""
    edges = triangles - np.roll(triangles, 1, axis=1)  # far from the origin, products of coordinates would cancel
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    edges = edges / np.where(longest > 0, longest, 1)[:, None, None]  # nor may their squares leave float64's range
    return np.asarray(np.linalg.norm(np.cross(edges[:, 1], edges[:, 2]), axis=1))

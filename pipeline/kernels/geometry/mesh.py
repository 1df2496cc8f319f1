"""A triangle mesh and its look, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from trimesh import graph


def is_watertight(faces: NDArray[np.integer]) -> bool:
    """Whether each edge of (F, 3) faces is shared by exactly two of them."""
    return bool(graph.is_watertight(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))[0])


@dataclass(frozen=True)
class Look:
    """The look of a mesh: one material per face, each with a base colour and perhaps a texture.

    Attributes
    ----------
    uv
        (V, 2) float32, texture coordinates of every vertex, v upwards; zeros where no material has a texture.
    face_material
        (F,) int32, the row of `base_color` that paints each face.
    base_color
        (M, 4) uint8, sRGB and opacity of every material; it multiplies the texture where there is one.
    material_texture
        (M,) int32, the index in `textures` of each material's texture, -1 for none.
    textures
        Images, each (height, width, 4) uint8, sRGB and opacity, first row at the top.
    vertex_color
        (V, 4) uint8, sRGB and opacity of every vertex, linear in between, which multiplies the base colour; None for white.
    """

    uv: NDArray[np.float32]
    face_material: NDArray[np.int32]
    base_color: NDArray[np.uint8]
    material_texture: NDArray[np.int32]
    textures: tuple[NDArray[np.uint8], ...] = ()
    vertex_color: NDArray[np.uint8] | None = None

    @staticmethod
    def plain(vertices: int, faces: int, color: tuple[int, int, int] = (178, 178, 178)) -> Look:
        """Make the look of one opaque colour for a mesh with these numbers of vertices and faces."""
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
        """Make a mesh of vertices (V, 3), m, and faces (F, 3) in plain grey."""
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
    """Compute the cross product of two edges of every face.

    Parameters
    ----------
    triangles
        (F, 3, 3) corner positions, m.

    Returns
    -------
    (F, 3) float64, m²: along the winding normal, with twice the face's area as length. The error is at most 4 units in the last place
    of the product of the two edges' lengths.
    """
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def flatness(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the height of every face over its longest edge.

    Parameters
    ----------
    triangles
        (F, 3, 3) float64 corner positions, any unit.

    Returns
    -------
    (F,) float64 ratio: 0.87 for equal sides, 0 for no area, at any scale.
    """
    edges = triangles - np.roll(triangles, 1, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    edges = edges / np.where(longest > 0, longest, 1)[:, None, None]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 1], edges[:, 2]), axis=1))

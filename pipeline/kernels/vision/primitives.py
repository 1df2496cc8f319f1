"""A mesh and its look as the arrays a graphics card wants: per material, vertices with one normal each, visible from both sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.shading import corner_normals

NORMAL_STEPS = 1023
"""Corners of one vertex whose normals agree to 1 part in so many share one entry: 0.06 degrees, no grey level."""


LARGEST_TEXTURE = 2048
"""Pixels a side: eight times those of an image of the default size."""


@dataclass(frozen=True)
class Primitive:
    """Triangles of one material.

    `positions`, `normals` (V, 3), `uv` (V, 2) float32; `indices` (2F, 3) uint32: every face once as it is wound and once turned over,
    so that it is seen from either side by a renderer that culls back faces. `color` (3,) is linear RGB; `texture` is an opaque image
    (height, width, 4) uint8, first row at the top, or None. In float32 a position is off by up to half a unit in its last place: 30 nm
    in the scene, 30 µm at a kilometre.
    """

    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    uv: NDArray[np.float32]
    indices: NDArray[np.uint32]
    color: NDArray[np.float64]
    texture: NDArray[np.uint8] | None


def primitives(mesh: Mesh) -> list[Primitive]:
    """The mesh's faces, gathered by what they look like: materials of one colour and texture are one primitive.

    Raises
    ------
    ValueError
        A corner or texture coordinate is NaN or infinite: a graphics card would draw something else, or nothing, and not say so.
    """
    if not (np.isfinite(mesh.triangles).all() and np.isfinite(mesh.look.uv).all()):
        raise ValueError(f"of {len(mesh.faces)} faces some have NaN or infinite corners or texture coordinates; gate the mesh first")
    normals = corner_normals(mesh.vertices, mesh.faces)
    look = mesh.look
    textures = [opaque(shrunk(texture)) for texture in look.textures]
    made = []
    for (*color, texture), chosen in looks(look):
        made.append(_primitive(mesh, look, normals, chosen, color, textures[texture] if texture >= 0 else None))
    return made


def looks(look: Look) -> list[tuple[list[int], NDArray[np.intp]]]:
    """Every colour with texture that some face wears, as [red, green, blue, number of the texture or -1], and these faces."""
    kinds, kind_of = np.unique(
        np.column_stack([look.base_color[:, :3], look.material_texture]).astype(np.int64), axis=0, return_inverse=True
    )
    kind_of_face = kind_of.reshape(-1)[look.face_material]
    worn = [(kind, np.flatnonzero(kind_of_face == number)) for number, kind in enumerate(kinds.tolist())]
    return [(kind, faces) for kind, faces in worn if len(faces)]


def _primitive(
    mesh: Mesh,
    look: Look,
    normals: NDArray[np.float64],
    chosen: NDArray[np.intp],
    color: list[int],
    texture: NDArray[np.uint8] | None,
) -> Primitive:
    vertex = mesh.faces[chosen].reshape(-1)  # (3F,)
    normal = normals[chosen].reshape(-1, 3)
    steps = np.round(normal * NORMAL_STEPS).astype(np.int64) + NORMAL_STEPS  # 0..2046, 11 bits each
    key = (vertex.astype(np.int64) << 33) | (steps[:, 0] << 22) | (steps[:, 1] << 11) | steps[:, 2]
    _, first, entry = np.unique(key, return_index=True, return_inverse=True)
    corner = entry.reshape(-1, 3)
    return Primitive(
        positions=mesh.vertices[vertex[first]].astype(np.float32),
        normals=normal[first].astype(np.float32),
        uv=look.uv[vertex[first]].astype(np.float32),
        indices=np.stack([corner, corner[:, ::-1]], axis=1).reshape(-1, 3).astype(np.uint32),  # twins side by side: cached vertices
        color=linear(np.array(color, np.uint8)),
        texture=texture,
    )


def linear(srgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Linear light, 0..1, of 8-bit sRGB values (IEC 61966-2-1)."""
    value = srgb / 255.0
    return np.asarray(np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4))


def shrunk(texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The texture, averaged down to at most `LARGEST_TEXTURE` pixels a side: no card takes every size, and no image shows it."""
    height, width = texture.shape[:2]
    factor = -(-max(height, width) // LARGEST_TEXTURE)
    return texture if factor <= 1 else np.array(Image.fromarray(texture).reduce(factor))


def opaque(texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A texture laid on white, so that the material's base colour shows where it is transparent.

    Nothing is see-through in an image: what the fingers feel is also seen, and a segmentation has one answer for each pixel.
    """
    if (texture[..., 3] == 255).all():
        return texture
    alpha = texture[..., 3:].astype(np.float64) / 255
    solid = texture.copy()
    solid[..., :3] = np.round(texture[..., :3] * alpha + 255 * (1 - alpha))
    solid[..., 3] = 255
    return solid

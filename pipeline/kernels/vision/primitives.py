"""Conversion of a mesh and its look to the primitives of a renderer: triangles per material, with one normal per vertex.

Valid range: positions become float32, hence meshes belong within a few metres of the origin (error 0.1 µm at 2 m).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.kernels.arrays import Array, Array32, Indices
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.corner_normals import corner_normals

NORMAL_STEPS = 1023  # corners of a vertex whose normals agree to its inverse, 0.06 degrees, share one entry
MAX_TEXTURE_SIDE = 2048  # pixels: every graphics card takes that; eight times the side of an image of the default size


@dataclass(frozen=True)
class Primitive:
    """Triangles of one material, for a renderer that culls back faces."""

    positions: Array32  # (V, 3)
    normals: Array32  # (V, 3)
    uv: Array32  # (V, 2)
    indices: NDArray[np.uint32]  # (2F, 3) every face once as it is wound and once turned over
    color: Array  # (3,) linear RGB
    texture: NDArray[np.uint8] | None  # (height, width, 4) opaque, first row at the top
    vertex_color: Array32 | None = None  # (V, 4) sRGB in 0..1, opaque: multiplies colour and texture


def mesh_primitives(mesh: Mesh) -> list[Primitive]:
    """Group a mesh's faces by colour and texture, and prepare each group for rendering, in the mesh's frame, m."""
    if not (np.isfinite(mesh.triangles).all() and np.isfinite(mesh.look.uv).all()):
        raise ValueError(f"of {len(mesh.faces)} faces some have NaN or infinite corners or texture coordinates; clean the mesh first")
    normals = corner_normals(mesh.vertices, mesh.faces)
    textures = [flatten_texture(shrink_texture(texture)) for texture in mesh.look.textures]
    return [
        _primitive(mesh, normals, faces, color, textures[texture] if texture >= 0 else None)
        for (*color, texture), faces in faces_by_material(mesh.look)
    ]


def faces_by_material(look: Look) -> list[tuple[list[int], Indices]]:
    """Group faces by appearance: [red, green, blue, texture index or -1], and the numbers of the faces that have it."""
    materials, material_of = np.unique(
        np.column_stack([look.base_color[:, :3], look.material_texture]).astype(np.int64), axis=0, return_inverse=True
    )
    material_of_face = material_of.reshape(-1)[look.face_material]
    groups = [(material, np.flatnonzero(material_of_face == number)) for number, material in enumerate(materials.tolist())]
    return [(material, faces) for material, faces in groups if len(faces)]


def _primitive(mesh: Mesh, normals: Array, faces: Indices, color: list[int], texture: NDArray[np.uint8] | None) -> Primitive:
    """Merge the faces' corners that share a vertex and, to `NORMAL_STEPS`, a normal."""
    from trimesh.visual.color import srgb_to_linear  # takes half a second

    vertex = mesh.faces[faces].reshape(-1)  # (3F,)
    normal = normals[faces].reshape(-1, 3)
    steps = np.round(normal * NORMAL_STEPS).astype(np.int64) + NORMAL_STEPS  # 0..2046, 11 bits each
    key = (vertex.astype(np.int64) << 33) | (steps[:, 0] << 22) | (steps[:, 1] << 11) | steps[:, 2]
    _, first, entry = np.unique(key, return_index=True, return_inverse=True)
    corner = entry.reshape(-1, 3)
    return Primitive(
        positions=mesh.vertices[vertex[first]].astype(np.float32),
        normals=normal[first].astype(np.float32),
        uv=mesh.look.uv[vertex[first]].astype(np.float32),
        indices=np.stack([corner, corner[:, ::-1]], axis=1).reshape(-1, 3).astype(np.uint32),
        color=srgb_to_linear(np.array(color, np.uint8)),
        texture=texture,
        vertex_color=None if mesh.look.vertex_color is None else _opaque(mesh.look.vertex_color[vertex[first]]),
    )


def _opaque(colors: NDArray[np.uint8]) -> Array32:
    """Return the colours (V, 4) in 0..1 without their opacity: every surface is rendered opaque."""
    opaque = (colors / 255).astype(np.float32)
    opaque[:, 3] = 1
    return opaque


def shrink_texture(texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Average a texture (height, width, 4) down by a whole factor to at most `MAX_TEXTURE_SIDE` pixels per side, rounded up."""
    height, width = texture.shape[:2]
    factor = -(-max(height, width) // MAX_TEXTURE_SIDE)
    return texture if factor <= 1 else np.array(Image.fromarray(texture).reduce(factor))


def flatten_texture(texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Blend a texture (height, width, 4) with white by its opacity: the base colour shows where it is transparent.

    Every surface is rendered opaque: surfaces that the fingers touch are visible, and a segmentation has one label per pixel.
    """
    if (texture[..., 3] == 255).all():
        return texture
    alpha = texture[..., 3:].astype(np.float64) / 255
    solid = texture.copy()
    solid[..., :3] = np.round(texture[..., :3] * alpha + 255 * (1 - alpha))
    solid[..., 3] = 255
    return solid

"""Conversion of a mesh and its look to the primitives of a renderer: triangles per material, with one shading normal per vertex.

Normals are smooth across gentle edges, sharp across creases, whatever the winding. Positions become float32.

Valid range: meshes from 1 µm to 1 km large, within a few metres of the origin (error 0.1 µm at 2 m); the error of a normal grows with
offset over size.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.kernels.arrays import Array, Array32, Indices
from pipeline.kernels.geometry.mesh import Look, Mesh, check_coordinates, face_cross_products
from pipeline.kernels.geometry.mesh_cleaning import number_positions
from pipeline.kernels.geometry.transforms import unit_vectors

CREASE = np.deg2rad(40.0)  # rad: faces that meet at more show an edge; a 12-sided cylinder looks round, a box does not
MAX_NEIGHBOURS = 64  # more faces meet at the hub of a fan (a cap, a cone's tip): its faces keep their own normals
PAIRS_PER_CHUNK = 1_000_000  # pairs of neighbouring corners processed together: about 100 MB
NORMAL_STEPS = 1023  # corners of a vertex whose normals agree to its inverse, 0.06 degrees, share one entry
MAX_TEXTURE_SIDE = 2048  # pixels: every graphics card takes that; eight times the side of an image of the default size


def corner_normals(vertices: Array, faces: NDArray[np.int32]) -> Array:
    """Compute a unit normal for every corner of every face, (F, 3, 3), on the side to which the face is wound.

    A corner's normal is the mean, weighted by the angle at the vertex, of the normals of those faces around its position that make less
    than `CREASE` with its own face. Faces wound the other way count as if turned over. A face without area has the normal +z and no
    influence on its neighbours. The normal of a sliver of aspect a has an error of up to 8 a units in the last place.
    """
    check_coordinates(vertices, "vertices")
    triangles = vertices[faces]  # (F, 3, 3)
    normal = unit_vectors(face_cross_products(triangles))
    has_area = normal.any(axis=1, keepdims=True)
    normal_of = np.repeat(np.where(has_area, normal, [0.0, 0.0, 1.0]), 3, axis=0)  # (3F, 3), one row per corner
    weighted = normal_of * (_corner_angles(triangles) * has_area).reshape(-1, 1)

    position = number_positions(vertices)[faces].reshape(-1)  # (3F,)
    order = np.argsort(position, kind="stable")
    count = np.bincount(position)
    first = np.cumsum(count) - count

    smooth = normal_of.copy()
    corners = order[count[position[order]] <= MAX_NEIGHBOURS]
    cuts = np.flatnonzero(np.diff(np.cumsum(count[position[corners]]) // PAIRS_PER_CHUNK)) + 1
    for chunk in filter(len, np.split(corners, cuts)):
        neighbours = count[position[chunk]]
        starts = np.cumsum(neighbours) - neighbours
        rank = np.arange(neighbours.sum()) - np.repeat(starts, neighbours)
        own, other = np.repeat(chunk, neighbours), order[np.repeat(first[position[chunk]], neighbours) + rank]  # (P,) pairs
        cosine = np.einsum("ij,ij->i", normal_of[own], normal_of[other])
        sign = np.where(np.abs(cosine) > np.cos(CREASE), np.sign(cosine), 0.0)
        smooth[chunk] = np.add.reduceat(weighted[other] * sign[:, None], starts)
    smooth = np.where(smooth.any(axis=1, keepdims=True), unit_vectors(smooth), normal_of)
    return smooth.reshape(-1, 3, 3)


def _corner_angles(triangles: Array) -> Array:  # (F, 3) rad
    ahead = np.roll(triangles, -1, axis=1) - triangles
    behind = np.roll(triangles, 1, axis=1) - triangles
    cross = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.asarray(np.arctan2(cross, np.einsum("fci,fci->fc", ahead, behind)))


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
    looks = np.column_stack([look.base_color[:, :3], look.material_texture]).astype(np.int64)
    materials, material_of = np.unique(looks, axis=0, return_inverse=True)
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
    colors = None
    if mesh.look.vertex_color is not None:
        colors = (mesh.look.vertex_color[vertex[first]] / 255).astype(np.float32)
        colors[:, 3] = 1  # every surface is rendered opaque
    return Primitive(
        positions=mesh.vertices[vertex[first]].astype(np.float32),
        normals=normal[first].astype(np.float32),
        uv=mesh.look.uv[vertex[first]].astype(np.float32),
        indices=np.stack([corner, corner[:, ::-1]], axis=1).reshape(-1, 3).astype(np.uint32),
        color=srgb_to_linear(np.array(color, np.uint8)),
        texture=texture,
        vertex_color=colors,
    )


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

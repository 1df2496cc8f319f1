"""Reading of mesh files in any of the usual formats, with their materials and textures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Look, Mesh

PLACEHOLDER = trimesh.visual.material.empty_material().image
"""The image that trimesh substitutes where a file has texture coordinates and no material."""

MAX_UV = 2.0**20
"""Repeats of a texture beyond which float32 cannot tell its pixels apart: such coordinates are damaged, and become 0."""

GREY = (178, 178, 178, 255)
"""The colour of faces without a material, as 3D Warehouse's default material."""


def load_mesh(file: Path) -> Mesh:
    """Read the triangles of a file, in its own units and axes, with their materials and textures.

    Raises
    ------
    InvalidInput
        The file is missing or empty, is not what its suffix says, or holds no triangle mesh.
    """
    if not file.is_file():
        raise InvalidInput(f"{file.name} is not there ({file}); put it back, or take it out of the manifest")
    if file.stat().st_size == 0:
        raise InvalidInput(f"{file.name} is an empty file")
    try:
        meshes = _read(file)
    except Exception as error:  # trimesh's readers raise whatever their parsing trips over
        try:
            meshes = _read(file, skip_materials=True)  # a damaged texture does not make the shape unusable
        except Exception:
            raise InvalidInput(f"{file.name} cannot be read as {file.suffix[1:].upper()}: {type(error).__name__}: {error}") from error
    if not meshes:
        raise InvalidInput(f"{file.name} holds no triangle mesh; is it text, a point cloud or an empty export?")
    return join_meshes(meshes)


def _read(file: Path, skip_materials: bool = False) -> list[Mesh]:
    options: Any = {"process": False, "skip_materials": skip_materials}
    scene = trimesh.load_scene(file, **options)
    return [_mesh(part) for part in scene.dump(concatenate=False) if isinstance(part, trimesh.Trimesh)]


def join_meshes(meshes: list[Mesh]) -> Mesh:
    """Join meshes to one, each keeping its look."""
    vertices, materials, textures = 0, 0, 0
    faces, face_material, material_texture = [], [], []
    for mesh in meshes:
        faces.append(mesh.faces + vertices)
        face_material.append(mesh.look.face_material + materials)
        texture = mesh.look.material_texture
        material_texture.append(np.where(texture >= 0, texture + textures, -1))
        vertices += len(mesh.vertices)
        materials += len(mesh.look.base_color)
        textures += len(mesh.look.textures)
    look = Look(
        uv=np.concatenate([mesh.look.uv for mesh in meshes]),
        face_material=np.concatenate(face_material).astype(np.int32),
        base_color=np.concatenate([mesh.look.base_color for mesh in meshes]),
        material_texture=np.concatenate(material_texture).astype(np.int32),
        textures=tuple(texture for mesh in meshes for texture in mesh.look.textures),
    )
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces).astype(np.int32), look)


def _mesh(part: trimesh.Trimesh) -> Mesh:
    vertices = np.asarray(part.vertices, np.float64)
    faces = np.asarray(part.faces, np.int32)
    return Mesh(vertices, faces, _look(part.visual, len(vertices), len(faces)))


def _look(visual: Any, vertices: int, faces: int) -> Look:
    """The look of one of trimesh's visuals, for a mesh with these numbers of vertices and faces."""
    if visual.kind == "texture":
        color, texture = _material(visual.material)
        uv = np.zeros((vertices, 2), np.float32)
        textured = texture is not None and visual.uv is not None and len(visual.uv) == vertices
        if textured:
            stated = np.asarray(visual.uv, np.float64)[:, :2]
            uv[:] = np.where(np.abs(stated) < MAX_UV, stated, 0)  # NaN too
        return Look(
            uv=uv,
            face_material=np.zeros(faces, np.int32),
            base_color=color[None],
            material_texture=np.array([0 if textured else -1], np.int32),
            textures=(texture,) if textured and texture is not None else (),
        )
    if visual.kind in ("face", "vertex"):
        # A vertex colour becomes the colour of the faces around it: `face_colors` takes their mean.
        colors, face_material = np.unique(np.asarray(visual.face_colors, np.uint8), axis=0, return_inverse=True)
        return Look(
            uv=np.zeros((vertices, 2), np.float32),
            face_material=face_material.reshape(-1).astype(np.int32),
            base_color=colors,
            material_texture=np.full(len(colors), -1, np.int32),
        )
    return Look.plain(vertices, faces, GREY[:3])


def _material(material: Any) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Base colour (4,) and texture (h, w, 4), sRGB, of one of trimesh's materials, whichever of its kinds it is."""
    if isinstance(material, trimesh.visual.material.PBRMaterial):  # glTF: a linear factor, white by default, times the texture
        factor = np.asarray([1, 1, 1, 1] if material.baseColorFactor is None else material.baseColorFactor)
        linear = factor / 255 if factor.dtype.kind in "iu" else factor.astype(float)
        return _srgb_from_linear(np.concatenate([linear, [1.0]])[:4]), _rgba(material.baseColorTexture)
    image, diffuse = getattr(material, "image", None), getattr(material, "diffuse", None)
    if image is not None and image.size == PLACEHOLDER.size and image.tobytes() == PLACEHOLDER.tobytes():
        return np.array(GREY, np.uint8), None  # the file states no material, or a missing one
    if image is not None:
        return np.full(4, 255, np.uint8), _rgba(image)
    color = np.asarray(GREY if diffuse is None else diffuse, np.uint8)
    return np.concatenate([color, [255]]).astype(np.uint8)[:4], None


def _srgb_from_linear(linear: NDArray[np.float64]) -> NDArray[np.uint8]:
    """8-bit sRGB of linear light (IEC 61966-2-1); opacity, the fourth value, stays linear."""
    light = np.clip(linear, 0, 1)
    encoded = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * np.concatenate([encoded[:3], light[3:]])), np.uint8)


def _rgba(image: Any) -> NDArray[np.uint8] | None:
    return None if image is None else np.array(image.convert("RGBA") if isinstance(image, Image.Image) else image, np.uint8)

"""Reading a mesh file of any of the usual formats, with its look."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from pipeline.kernels.geometry.mesh import Look, Mesh

GREY = (178, 178, 178, 255)
"""The colour of what states none, as 3D Warehouse's default material."""


def load_mesh(file: Path) -> Mesh:
    """The triangles of a file, in its own units and axes, with its materials and textures.

    Raises
    ------
    ValueError
        The file is empty, is not what its suffix says, or holds no triangle mesh.
    """
    if file.stat().st_size == 0:
        raise ValueError(f"{file.name} is an empty file")
    try:
        scene = trimesh.load_scene(file, process=False, skip_materials=False)
        parts = [part for part in scene.dump(concatenate=False) if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # trimesh's readers raise whatever their parsing trips over
        raise ValueError(f"{file.name} cannot be read as {file.suffix[1:].upper()}: {type(error).__name__}: {error}") from error
    if not parts:
        raise ValueError(f"{file.name} holds no triangle mesh; is it text, a point cloud or an empty export?")
    return join([_mesh(part) for part in parts])


def join(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one, each keeping its look."""
    vertices, materials, textures = 0, 0, 0
    faces, face_material, material_texture = [], [], []
    for mesh in meshes:
        faces.append(mesh.faces + vertices)
        face_material.append(mesh.look.face_material + materials)
        worn = mesh.look.material_texture
        material_texture.append(np.where(worn >= 0, worn + textures, -1))
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
    if visual.kind == "texture":
        colour, texture = _material(visual.material)
        uv = np.zeros((vertices, 2), np.float32)
        textured = texture is not None and visual.uv is not None and len(visual.uv) == vertices
        if textured:
            uv[:] = np.nan_to_num(np.asarray(visual.uv)[:, :2], posinf=0, neginf=0)
        return Look(
            uv=uv,
            face_material=np.zeros(faces, np.int32),
            base_color=colour[None],
            material_texture=np.array([0 if textured else -1], np.int32),
            textures=(texture,) if textured and texture is not None else (),
        )
    if visual.kind in ("face", "vertex"):
        # A vertex colour becomes the colour of the faces around it: `face_colors` takes their mean.
        colours, face_material = np.unique(np.asarray(visual.face_colors, np.uint8), axis=0, return_inverse=True)
        return Look(
            uv=np.zeros((vertices, 2), np.float32),
            face_material=face_material.reshape(-1).astype(np.int32),
            base_color=colours,
            material_texture=np.full(len(colours), -1, np.int32),
        )
    return Look.plain(vertices, faces, GREY[:3])


def _material(material: Any) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Base colour (4,) and texture (h, w, 4) of one of trimesh's materials, whichever of its kinds it is."""
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    colour = getattr(material, "baseColorFactor", None)
    if colour is None:
        colour = getattr(material, "diffuse", None)
    if image is not None:
        texture = np.asarray(image.convert("RGBA") if isinstance(image, Image.Image) else image, np.uint8)
        return np.full(4, 255, np.uint8), texture
    colour = np.asarray(GREY if colour is None else colour)
    if colour.dtype.kind == "f":
        colour = np.clip(np.rint(colour * 255), 0, 255)
    colour = colour.astype(np.uint8)
    return np.concatenate([colour, [255]]).astype(np.uint8)[:4], None

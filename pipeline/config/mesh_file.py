"""Mesh files in any of the usual formats, with their materials and textures."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

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
        raise InvalidInput(f"{file.name} is not there ({file}); put it back, or mend the file that names it")
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
    return _join(meshes)


def _read(file: Path, skip_materials: bool = False) -> list[Mesh]:
    options: Any = {"process": False, "skip_materials": skip_materials}
    parts = trimesh.load_scene(file, **options).dump(concatenate=False)
    return [
        Mesh(np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int32), _look(part))
        for part in parts
        if isinstance(part, trimesh.Trimesh)
    ]


def _join(meshes: list[Mesh]) -> Mesh:
    """Join meshes to one, each keeping its look."""
    looks = [mesh.look for mesh in meshes]
    look = Look(
        uv=np.concatenate([look.uv for look in looks]),
        face_material=_join_indices([look.face_material for look in looks], [look.base_color for look in looks]),
        base_color=np.concatenate([look.base_color for look in looks]),
        material_texture=_join_indices([look.material_texture for look in looks], [look.textures for look in looks]),
        textures=tuple(texture for look in looks for texture in look.textures),
    )
    vertices = [mesh.vertices for mesh in meshes]
    return Mesh(np.concatenate(vertices), _join_indices([mesh.faces for mesh in meshes], vertices), look)


def _join_indices(indices: Sequence[NDArray[np.int32]], lists: Sequence[Sized]) -> NDArray[np.int32]:
    """Join arrays of indices into lists that are joined too; -1, for none, stays."""
    starts = np.cumsum([0, *map(len, lists[:-1])])
    joined = [np.where(part < 0, part, part + start) for part, start in zip(indices, starts, strict=True)]
    return np.concatenate(joined).astype(np.int32)


def _look(part: trimesh.Trimesh) -> Look:
    visual: Any = part.visual
    colors, texture = np.array([GREY], np.uint8), None
    uv = np.zeros((len(part.vertices), 2), np.float32)
    face_material: NDArray[Any] = np.zeros(len(part.faces), np.int32)
    if visual.kind == "texture":
        colors[0], texture = _material(visual.material)
        if visual.uv is None or len(visual.uv) != len(uv):
            texture = None
        elif texture is not None:
            stated = np.asarray(visual.uv, np.float64)[:, :2]
            uv[:] = np.where(np.abs(stated) < MAX_UV, stated, 0)  # NaN too
    elif visual.kind in ("face", "vertex"):
        # A vertex colour becomes the colour of the faces around it: `face_colors` takes their mean.
        colors, face_material = np.unique(np.asarray(visual.face_colors, np.uint8), axis=0, return_inverse=True)
    return Look(
        uv=uv,
        face_material=face_material.reshape(-1).astype(np.int32),
        base_color=colors,
        material_texture=np.full(len(colors), -1 if texture is None else 0, np.int32),
        textures=() if texture is None else (texture,),
    )


def _material(material: Any) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Read base colour (4,) and texture (h, w, 4), sRGB, of one of trimesh's materials, whichever of its kinds it is."""
    color, image = np.full(4, 255, np.uint8), getattr(material, "image", None)
    if isinstance(material, trimesh.visual.material.PBRMaterial):  # glTF: a linear factor, white by default, times the texture
        image = material.baseColorTexture
        if material.baseColorFactor is not None:
            color[:3] = np.rint(255 * trimesh.visual.color.linear_to_srgb(material.baseColorFactor[:3]))
            color[3] = material.baseColorFactor[3]
    elif image is None:
        color[:] = getattr(material, "diffuse", GREY)
    elif image.size == PLACEHOLDER.size and image.tobytes() == PLACEHOLDER.tobytes():
        color[:], image = GREY, None  # the file states no material, or a missing one
    return color, None if image is None else np.array(image.convert("RGBA"))

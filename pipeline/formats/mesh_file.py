"""Mesh files in any of the usual formats, with their materials and textures."""

from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.collada import read_collada
from pipeline.formats.file_content import MESH_SUFFIXES, refuse_foreign
from pipeline.formats.gltf_scene import read_gltf
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import check_mesh, unique_materials
from pipeline.formats.obj import read_obj
from pipeline.formats.off import read_off
from pipeline.formats.ply import read_ply
from pipeline.formats.stl import read_stl
from pipeline.formats.textures import Textures
from pipeline.formats.threemf import read_threemf
from pipeline.kernels.geometry.mesh import Look, Mesh

READERS: Mapping[str, Callable[[Companions, Textures], Iterable[Mesh]]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".off": read_off,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".dae": read_collada,
    ".3mf": read_threemf,
}
"""The reader of each format: it yields the parts of a file, each in its pose, and appends what is not read to `Companions.unread`."""


def parse_mesh(file: Path, root: Path | str) -> Mesh:
    """Read a mesh file in this process, without limits; otherwise like `mesh_reader.load_mesh`."""
    if file.suffix.lower() not in READERS:
        raise InvalidInput(f"{file.name} cannot be read; convert it to one of {', '.join(MESH_SUFFIXES)}")
    companions = Companions(file, Path(root))
    parts, faces, vertices = list[Mesh](), 0, 0
    try:
        for part in READERS[file.suffix.lower()](companions, Textures(companions, companions.unread)):
            faces, vertices = faces + len(part.faces), vertices + len(part.vertices)
            check_mesh(faces, vertices)
            parts += [part] if len(part.faces) else []
        unread = tuple(dict.fromkeys(companions.unread))
        if not parts:
            reasons = "".join(f"; {reason}" for reason in unread)
            raise InvalidInput(f"it holds no triangle mesh; is it cut off, text, a point cloud or an empty export?{reasons}")
    except MemoryError:
        raise
    except Exception as error:  # whatever parsing a damaged file trips over
        refuse_foreign(file.name, companions.content)
        if isinstance(error, InvalidInput):
            raise InvalidInput(f"{file.name}: {error}") from error
        reason = f"{file.name} cannot be read as {file.suffix[1:].upper()}: {type(error).__name__}: {error}"
        raise InvalidInput(f"{reason}; write it again with another program, as triangles") from error
    return replace(_join(parts), unread=unread)


def _join(meshes: Sequence[Mesh]) -> Mesh:
    looks = [mesh.look for mesh in meshes]
    textures = list({id(texture): texture for look in looks for texture in look.textures}.values())
    numbers = {id(texture): number for number, texture in enumerate(textures)}
    own = [np.array([*(numbers[id(texture)] for texture in look.textures), -1], np.int32) for look in looks]  # its last row is for -1
    colors = None  # of vertices, white where a part states none
    if any(look.vertex_color is not None for look in looks):
        whites = (np.full((len(look.uv), 4), 255, np.uint8) for look in looks)
        colors = np.concatenate([w if look.vertex_color is None else look.vertex_color for look, w in zip(looks, whites, strict=True)])
    material_texture = np.concatenate([rows[look.material_texture] for rows, look in zip(own, looks, strict=True)])
    base_color, material_texture, material = unique_materials(np.concatenate([look.base_color for look in looks]), material_texture)
    face_material = _join_indices([look.face_material for look in looks], [look.base_color for look in looks])
    look = Look(
        uv=np.concatenate([look.uv for look in looks]),
        face_material=material[face_material],
        base_color=base_color,
        material_texture=material_texture,
        textures=tuple(textures),
        vertex_color=colors,
    )
    vertices = [mesh.vertices for mesh in meshes]
    return Mesh(np.concatenate(vertices), _join_indices([mesh.faces for mesh in meshes], vertices), look)


def _join_indices(indices: Sequence[NDArray[np.int32]], lists: Sequence[Sized]) -> NDArray[np.int32]:
    """Join arrays of indices into lists that are joined too."""
    starts = np.cumsum([0, *map(len, lists[:-1])])
    return np.concatenate([part + start for part, start in zip(indices, starts, strict=True)]).astype(np.int32)

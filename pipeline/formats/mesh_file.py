"""Mesh files in any of the usual formats, with their materials and textures."""

from collections.abc import Sequence, Set, Sized
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.errors import InvalidInput, first_line
from pipeline.formats import obj
from pipeline.formats.collada import check_shape, cut_concave, rewrite_effects
from pipeline.formats.file_content import MESH_SUFFIXES, refuse_foreign
from pipeline.formats.gltf_scene import read_gltf
from pipeline.formats.mesh_companions import ALL_LIBRARIES, Companions
from pipeline.formats.mesh_parts import GREY, WHITE, build_part, check_corners, check_mesh
from pipeline.formats.obj import check_statements, rewrite_lines, rewrite_uses, usual_text
from pipeline.formats.off import read_off
from pipeline.formats.ply import read_ply
from pipeline.formats.stl import read_stl
from pipeline.formats.textures import Textures
from pipeline.formats.threemf import read_threemf
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Look, Mesh

PLACEHOLDER = trimesh.visual.material.empty_material().image
PLACEHOLDER_PIXELS = np.array(PLACEHOLDER.convert("RGBA"))
"""The image that trimesh substitutes where a file has texture coordinates and no material."""
trimesh.util.log.disabled = True  # it logs tracebacks of what it recovers from


def parse_mesh(file: Path, root: Path) -> Mesh:
    """Read a mesh file in this process, without limits; otherwise like `mesh_reader.load_mesh`."""
    if file.suffix.lower() not in MESH_SUFFIXES:
        raise InvalidInput(f"{file.name} cannot be read; convert it to one of {', '.join(MESH_SUFFIXES)}")
    companions = Companions(file, root)
    try:
        meshes = [mesh for mesh in _read_parts(file, companions) if len(mesh.faces)]
    except InvalidInput as error:
        refuse_foreign(file.name, companions.content)
        raise InvalidInput(f"{file.name}: {error}") from error
    except MemoryError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their parsing trips over
        if "memory" in str(error).lower() and not isinstance(error, OSError):  # libxml2 calls it a fault of the XML
            raise MemoryError from error
        refuse_foreign(file.name, companions.content)
        reason = f"{file.name} cannot be read as {file.suffix[1:].upper()}: {type(error).__name__}: {error}"
        raise InvalidInput(f"{reason}; write it again with another program, as triangles") from error
    if not meshes:
        refuse_foreign(file.name, companions.content)
        left_out = "".join(f"; {reason}" for reason in dict.fromkeys(companions.unread))
        raise InvalidInput(f"{file.name} holds no triangle mesh; is it cut off, text, a point cloud or an empty export?{left_out}")
    return replace(_join(meshes), unread=tuple(dict.fromkeys(companions.unread)))


def _read_parts(file: Path, companions: Companions) -> list[Mesh]:
    """Read the parts of a file; of one that trimesh reads, without materials if they are damaged: the shape is still usable."""
    content, unread, transparent = companions.content, companions.unread, set[str]()
    match file.suffix.lower():
        case ".stl":
            return read_stl(content, unread)
        case ".off":
            return read_off(content, unread)
        case ".ply":
            return read_ply(content, companions, partial(Textures(companions).read, opaque=True), unread)
        case ".gltf" | ".glb":
            return read_gltf(companions, Textures(companions).read)
        case ".3mf":
            return read_threemf(content, Textures(companions).read, unread)
        case ".obj":
            content = usual_text(content)
            check_statements(content, unread)
            content = rewrite_uses(rewrite_lines(content), companions[ALL_LIBRARIES], unread)
            content = b"mtllib %s\n%s" % (ALL_LIBRARIES.encode(), content)
        case ".dae":
            check_shape(content)
            content, transparent = rewrite_effects(cut_concave(content), unread)
    try:
        return _read(content, file, companions, transparent)
    except (InvalidInput, MemoryError):
        raise
    except Exception as error:
        parts = _read(content, file, companions, transparent, skip_materials=True)
        unread.append(f"materials are not read ({type(error).__name__}: {first_line(error)})")
        return parts


def _read(content: bytes, file: Path, companions: Companions, transparent: Set[str], skip_materials: bool = False) -> list[Mesh]:
    """Read the parts of a file from its content, each in its pose; `transparent` is as for `Textures`."""
    suffix = file.suffix.lower()
    options: Any = {"process": False, "skip_materials": skip_materials, "resolver": companions, "file_type": suffix[1:]}
    scene: Any = trimesh.load_scene(BytesIO(content), **options)
    parts = {name: part for name, part in scene.geometry.items() if isinstance(part, trimesh.Trimesh) and len(part.faces)}
    nodes = [(pose, name) for pose, name in (scene.graph[node] for node in scene.graph.nodes_geometry) if name in parts]
    check_mesh(sum(len(parts[name].faces) for _, name in nodes), sum(len(parts[name].vertices) for _, name in nodes))
    textures = Textures(companions, transparent)
    looks = {name: _look(part, textures) for name, part in parts.items()}
    return [_build(parts[name], pose, looks[name]) for pose, name in nodes]


def _build(part: Any, pose: Array, look: dict[str, Any]) -> Mesh:
    part = part.copy(include_visual=False)
    if np.ndim(part.vertices) != 2 or part.vertices.shape[1] != 3:
        raise ValueError(f"vertices have shape {np.shape(part.vertices)}, not (n, 3)")
    check_corners(part.faces, len(part.vertices))
    part.apply_transform(pose)
    return build_part(part.vertices, part.faces, **look)


def _look(part: trimesh.Trimesh, textures: Textures) -> dict[str, Any]:
    visual: Any = part.visual
    color, uv, texture = np.array(WHITE if visual.kind == "vertex" else GREY, np.uint8), None, None
    if visual.kind == "texture":
        color, texture = _material(visual.material, textures)
        textures.unread += obj.losses(visual.material, visual.uv)
        if texture is not None and visual.uv is not None and len(visual.uv) == len(part.vertices):
            uv = np.asarray(visual.uv, np.float64)[:, :2]
    return {
        "face_color": np.tile(color, (len(part.faces), 1)),
        "vertex_color": _vertex_color(visual, len(part.vertices)),
        "uv": uv,
        "page": np.zeros(len(part.faces), np.int64),
        "textures": (texture,),
    }


def _join(meshes: list[Mesh]) -> Mesh:
    looks = [mesh.look for mesh in meshes]
    textures = list({id(texture): texture for look in looks for texture in look.textures}.values())
    numbers = {id(texture): number for number, texture in enumerate(textures)}
    look = Look(
        uv=np.concatenate([look.uv for look in looks]),
        face_material=_join_indices([look.face_material for look in looks], [look.base_color for look in looks]),
        base_color=np.concatenate([look.base_color for look in looks]),
        material_texture=np.concatenate([_renumber(look, numbers) for look in looks]),
        textures=tuple(textures),
        vertex_color=_join_colors(looks),
    )
    vertices = [mesh.vertices for mesh in meshes]
    return Mesh(np.concatenate(vertices), _join_indices([mesh.faces for mesh in meshes], vertices), look)


def _join_colors(looks: Sequence[Look]) -> NDArray[np.uint8] | None:
    """Join the colours of vertices, white where a part states none; None where no part does."""
    if all(look.vertex_color is None for look in looks):
        return None
    white = (np.full((len(look.uv), 4), 255, np.uint8) for look in looks)
    return np.concatenate([blank if look.vertex_color is None else look.vertex_color for look, blank in zip(looks, white, strict=True)])


def _join_indices(indices: Sequence[NDArray[np.int32]], lists: Sequence[Sized]) -> NDArray[np.int32]:
    """Join arrays of indices into lists that are joined too; -1, for none, stays."""
    starts = np.cumsum([0, *map(len, lists[:-1])])
    joined = [np.where(part < 0, part, part + start) for part, start in zip(indices, starts, strict=True)]
    return np.concatenate(joined).astype(np.int32)


def _renumber(look: Look, numbers: dict[int, int]) -> NDArray[np.int32]:
    """Renumber the textures of a look's materials by identity; -1, for none, stays."""
    return np.array([-1 if index < 0 else numbers[id(look.textures[index])] for index in look.material_texture], np.int32)


def _vertex_color(visual: Any, count: int) -> NDArray[np.uint8] | None:
    """Return the (V, 4) sRGB colours of vertices, where a part states them, alone or beside a material."""
    stored = visual.vertex_colors if visual.kind == "vertex" else getattr(visual, "vertex_attributes", {}).get("color")
    if stored is None or len(stored) != count:
        return None
    stored = np.rint(stored / 257).astype(np.uint8) if stored.dtype == np.uint16 else stored  # trimesh would take the lower eight bits
    return np.array(trimesh.visual.color.to_rgba(stored), np.uint8)


def _material(material: Any, textures: Textures) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Read base colour (4,) and texture (h, w, 4), sRGB, of any of trimesh's kinds of materials."""
    color = np.full(4, 255, np.uint8)
    if isinstance(material, trimesh.visual.material.PBRMaterial):  # of COLLADA: a factor, white by default, times the texture
        if material.baseColorFactor is not None:
            color[:] = material.baseColorFactor
        image = material.baseColorTexture
        return color, None if image is None else textures.decode(image, opaque=not textures.is_transparent(image))
    values, image = getattr(material, "kwargs", {}), getattr(material, "image", None)
    texture = None if image is None else textures.decode(image, opaque=not obj.keeps_alpha(values, image.info.get("file_path", "")))
    if texture is None:
        color[:] = getattr(material, "diffuse", GREY) if image is None or "kd" in values else GREY
        if (light := obj.emission(values)) is not None:
            color[:3] = np.rint(255 * light)
    color[3] = round(255 * obj.opacity(values))
    if image is not None and texture is not None and image.mode == PLACEHOLDER.mode and np.array_equal(texture, PLACEHOLDER_PIXELS):
        color[:], texture = GREY, None  # the file states no material, or a missing one
    return color, texture

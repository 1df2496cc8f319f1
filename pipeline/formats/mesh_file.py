"""Mesh files in any of the usual formats, with their materials and textures."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence, Sized
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import MESH_SUFFIXES
from pipeline.formats.gltf_scene import read_gltf
from pipeline.formats.mesh_companions import ALL_LIBRARIES, Companions, decode_text
from pipeline.formats.mesh_parts import GREY, MAX_UV, Decode, check_count, check_mesh
from pipeline.formats.mesh_reader import read_in_subprocess
from pipeline.formats.obj_lines import rewrite_lines
from pipeline.kernels.geometry.mesh import Look, Mesh

PLACEHOLDER = trimesh.visual.material.empty_material().image
PLACEHOLDER_PIXELS = np.array(PLACEHOLDER.convert("RGBA"))
"""The image that trimesh substitutes where a file has texture coordinates and no material."""

FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "WEBP", "DDS", "PPM", "PCX", "MPO")
"""Accepted formats of textures. Pillow would read others too, some by starting other programs."""

MAX_PIXELS = 2**26
"""Maximum number of pixels of all textures of a mesh file: one of 8192 × 8192, 256 MiB as RGBA."""

trimesh.util.log.disabled = True  # it logs tracebacks of what it recovers from


def load_mesh(file: Path, root: Path | None = None) -> Mesh:
    """Read the triangles of a file, in its own units and axes, with their materials and textures.

    Parameters
    ----------
    file
        The mesh file.
    root
        The folder that the files it names must be in; by default, the folder of the file.

    Raises
    ------
    InvalidInput
        The file is missing or empty, is not what its suffix says, holds no triangle mesh, or takes too much memory or time.
    """
    return read_in_subprocess(file, root or file.parent)


def parse_mesh(file: Path, root: Path) -> Mesh:
    """Read a mesh file in this process, without limits; otherwise like `load_mesh`.

    Raises
    ------
    InvalidInput
        As for `load_mesh`.
    MemoryError
        It takes more memory than there is.
    """
    if file.suffix.lower() not in MESH_SUFFIXES:
        raise InvalidInput(f"{file.name} cannot be read; convert it to one of {', '.join(MESH_SUFFIXES)}")
    companions = Companions(file, root)
    try:
        meshes = _read_parts(file, companions)
    except InvalidInput as error:
        raise InvalidInput(f"{file.name}: {error}") from error
    except MemoryError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their parsing trips over
        if "memory" in str(error).lower() and not isinstance(error, OSError):  # libxml2 calls it a fault of the XML
            raise MemoryError from error
        reason = f"{file.name} cannot be read as {file.suffix[1:].upper()}: {type(error).__name__}: {error}"
        raise InvalidInput(f"{reason}; write it again with another program, as triangles") from error
    if not meshes:
        left_out = "".join(f"; {reason}" for reason in dict.fromkeys(companions.unread))
        raise InvalidInput(f"{file.name} holds no triangle mesh; is it cut off, text, a point cloud or an empty export?{left_out}")
    return replace(_join(meshes), unread=tuple(dict.fromkeys(companions.unread)))


def _read_parts(file: Path, companions: Companions) -> list[Mesh]:
    """Read the parts of a file, without materials if they are damaged: the shape is still usable."""
    if file.suffix.lower() in (".gltf", ".glb"):
        return read_gltf(companions, _decoder(companions.unread))
    content = b"mtllib %s\n%s" % (ALL_LIBRARIES.encode(), rewrite_lines(companions.content)) if file.suffix.lower() == ".obj" else file
    try:
        return _read(content, file, companions)
    except (InvalidInput, MemoryError):
        raise
    except (ModuleNotFoundError, UnicodeDecodeError):  # text that is not UTF-8: trimesh needs a package to guess its encoding
        text, end, data = (companions.content if isinstance(content, Path) else content).partition(
            b"end_header"
        )  # after it a PLY is binary
        return _read(decode_text(text).encode() + end + data, file, companions)
    except Exception:
        return _read(content, file, companions, skip_materials=True)


def _decoder(unread: list[str]) -> Decode:
    """Return a function that decodes the textures of one file, and notes those that it cannot."""
    textures, images = _Textures(), list[Image.Image]()  # which knows images by their identity

    def decode(name: str, content: bytes) -> NDArray[np.uint8] | None:
        try:
            images.append(Image.open(BytesIO(content)))
            return textures.decode(images[-1])
        except (OSError, ValueError) as error:
            unread.append(f"{name} cannot be decoded: {str(error).partition(' <')[0]}")
            return None

    return decode


class _Textures:
    """The decoded textures of one mesh file, of which several materials may use one."""

    def __init__(self) -> None:
        self._decoded: dict[str, NDArray[np.uint8]] = {}
        self._digests: dict[int, str] = {}  # Pillow forgets a file's content when it is decoded
        self._pixels = 0

    def decode(self, image: Image.Image) -> NDArray[np.uint8]:
        """Decode an image to (height, width, 4) uint8 sRGB and opacity; the same array for the same content.

        Raises
        ------
        InvalidInput
            The textures so far and this one have too many pixels.
        ValueError, OSError
            Its format is not accepted, or it is damaged.
        """
        digest = self._digests.setdefault(id(image), _digest(image))
        if digest not in self._decoded:
            if image.format not in (None, *FORMATS):  # None: made by a conversion
                raise ValueError(f"a texture is {image.format}; convert it to PNG or JPEG")
            self._pixels += image.width * image.height
            check_count("pixels of textures", self._pixels, MAX_PIXELS, "make them smaller")
            self._decoded[digest] = np.array(_eight_bits(image).convert("RGBA"))
        return self._decoded[digest]


def _eight_bits(image: Image.Image) -> Image.Image:
    """Scale an image of 16 bits of grey, which Pillow's conversion would cut off at 255."""
    return Image.fromarray(np.rint(np.asarray(image) / 257).astype(np.uint8)) if image.mode.startswith("I;16") else image


def _digest(image: Image.Image) -> str:
    file = getattr(image, "fp", None)
    return hashlib.sha256(file.getbuffer()).hexdigest() if isinstance(file, BytesIO) else str(id(image))


def _read(content: Path | bytes, file: Path, companions: Companions, skip_materials: bool = False) -> list[Mesh]:
    """Read the parts of a file, from its path or from content in its place, each in its pose."""
    suffix = file.suffix.lower()
    options: Any = {"process": False, "skip_materials": skip_materials, "resolver": companions, "file_type": suffix[1:]}
    scene: Any = trimesh.load_scene(content if isinstance(content, Path) else BytesIO(content), **options)
    parts = {name: part for name, part in scene.geometry.items() if isinstance(part, trimesh.Trimesh) and len(part.faces)}
    nodes = [(pose, name) for pose, name in (scene.graph[node] for node in scene.graph.nodes_geometry) if name in parts]
    check_mesh(sum(len(parts[name].faces) for _, name in nodes), sum(len(parts[name].vertices) for _, name in nodes))
    textures = _Textures()
    looks = {name: _look(part, textures) for name, part in parts.items()}
    return [_placed(parts[name], pose, looks[name]) for pose, name in nodes]


def _placed(part: Any, pose: NDArray[np.float64], look: Look) -> Mesh:
    """Copy the triangles of a part, transformed by its pose."""
    part = part.copy(include_visual=False)
    if np.ndim(part.vertices) != 2 or part.vertices.shape[1] != 3:
        raise ValueError(f"vertices have shape {np.shape(part.vertices)}, not (n, 3)")
    if len(part.faces) and not (part.faces.min() >= 0 and part.faces.max() < len(part.vertices)):
        raise ValueError(f"a face names a vertex outside 0..{len(part.vertices) - 1}")
    part.apply_transform(pose)
    return Mesh(np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int32), look)


def _join(meshes: list[Mesh]) -> Mesh:
    """Join meshes into one; each part keeps its look."""
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


def _look(part: trimesh.Trimesh, textures: _Textures) -> Look:
    visual: Any = part.visual
    colors, texture = np.array([GREY], np.uint8), None
    uv = np.zeros((len(part.vertices), 2), np.float32)
    face_material: NDArray[Any] = np.zeros(len(part.faces), np.int32)
    if visual.kind == "texture":
        colors[0], texture = _material(visual.material, textures)
        if visual.uv is None or len(visual.uv) != len(uv):
            texture = None
        elif texture is not None:
            coordinates = np.asarray(visual.uv, np.float64)[:, :2]
            uv[:] = np.where(np.abs(coordinates) < MAX_UV, coordinates, 0)  # NaN too
    elif visual.kind == "vertex":
        colors[0] = 255
    elif visual.kind == "face":
        colors, face_material = np.unique(np.asarray(visual.face_colors, np.uint8), axis=0, return_inverse=True)
    return Look(
        uv=uv,
        face_material=face_material.reshape(-1).astype(np.int32),
        base_color=colors,
        material_texture=np.full(len(colors), -1 if texture is None else 0, np.int32),
        textures=() if texture is None else (texture,),
        vertex_color=_vertex_color(visual, len(part.vertices)),
    )


def _vertex_color(visual: Any, count: int) -> NDArray[np.uint8] | None:
    """Return the (V, 4) sRGB colours of vertices, where a part states them, alone or beside a material."""
    stored = visual.vertex_colors if visual.kind == "vertex" else getattr(visual, "vertex_attributes", {}).get("color")
    if stored is None or len(stored) != count:
        return None
    stored = np.rint(stored / 257).astype(np.uint8) if stored.dtype == np.uint16 else stored  # trimesh would take the lower eight bits
    return np.array(trimesh.visual.color.to_rgba(stored), np.uint8)


def _material(material: Any, textures: _Textures) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Read base colour (4,) and texture (h, w, 4), sRGB, of any of trimesh's kinds of materials."""
    color = np.full(4, 255, np.uint8)
    if isinstance(material, trimesh.visual.material.PBRMaterial):  # of COLLADA: a factor, white by default, times the texture
        if material.baseColorFactor is not None:
            color[:] = material.baseColorFactor
        return color, None if material.baseColorTexture is None else textures.decode(material.baseColorTexture)
    image: Any = getattr(material, "image", None)
    if image is None:
        color[:] = getattr(material, "diffuse", GREY)
    texture = None if image is None else textures.decode(image)
    if texture is not None and image.mode == PLACEHOLDER.mode and np.array_equal(texture, PLACEHOLDER_PIXELS):
        color[:], texture = GREY, None  # the file states no material, or a missing one
    return color, texture

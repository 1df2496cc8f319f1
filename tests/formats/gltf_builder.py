"""glTF files of tests: JSON with arrays and images in data URIs."""

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from pipeline.formats.mesh_file import parse_mesh
from pipeline.kernels.geometry.mesh import Mesh

BOX = trimesh.creation.box((1, 2, 3))
CORNERS = BOX.vertices.astype(np.float32)
COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A document in `tree`; arrays and images are appended, and named by their numbers."""

    def __init__(self) -> None:
        lists: tuple[str, ...] = ("accessors", "bufferViews", "buffers", "images", "textures", "samplers", "materials", "skins")
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, **{name: [] for name in lists}}

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an entry to a list of the document."""
        self.tree[kind].append(entry)
        return len(self.tree[kind]) - 1

    def view(self, content: bytes, **entries: Any) -> int:
        """Append bytes."""
        buffer = self.add("buffers", {"byteLength": len(content), "uri": data_uri(content)})
        return self.add("bufferViews", {"buffer": buffer, "byteLength": len(content), **entries})

    def array(self, array: NDArray[Any], **entries: Any) -> int:
        """Append an array (N,) or (N, width)."""
        width = 1 if array.ndim == 1 else array.shape[1]
        entry = {"componentType": COMPONENTS[array.dtype.name], "type": TYPES[width], "count": len(array), **entries}
        return self.add("accessors", {"bufferView": self.view(array.tobytes()), **entry})

    def sparse(self, rows: list[int], values: NDArray[Any], count: int) -> int:
        """Append an array that is zero except for some rows."""
        places = {"bufferView": self.view(np.array(rows, np.uint16).tobytes()), "componentType": 5123}
        of = {"count": len(rows), "indices": places, "values": {"bufferView": self.view(values.tobytes())}}
        return self.add("accessors", {"componentType": 5126, "type": TYPES[values.shape[1]], "count": count, "sparse": of})

    def box(self, **attributes: NDArray[Any]) -> dict[str, Any]:
        """Append the box of 1 × 2 × 3; return it as a primitive."""
        arrays = {"POSITION": CORNERS, **attributes}
        return {
            "attributes": {name: self.array(array) for name, array in arrays.items()},
            "indices": self.array(BOX.faces.ravel().astype(np.uint16)),
        }

    def texture(self, pixels: Any, **entries: Any) -> int:
        """Append a texture of sRGB pixels (height, width, 3 or 4)."""
        Image.fromarray(np.array(pixels, np.uint8)).save(file := io.BytesIO(), "PNG")
        return self.add("textures", {"source": self.add("images", {"uri": data_uri(file.getvalue())}), **entries})

    def write(self, path: Path, *primitives: dict[str, Any], **entries: Any) -> Path:
        """Write the document with these primitives as mesh 0, which node 0 shows unless `entries` say otherwise."""
        shown = {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [{"primitives": list(primitives)}]}
        path.write_text(json.dumps(self.tree | shown | entries))
        return path

    def read(self, folder: Path, *primitives: dict[str, Any], **entries: Any) -> Mesh:
        """Write the document, and read it."""
        return parse_mesh(self.write(folder / "a.gltf", *primitives, **entries), folder)


def data_uri(content: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(content).decode()


def glb(text: bytes, binary: bytes | None = None, version: int = 2) -> bytes:
    """Pack JSON, and perhaps the content of buffer 0, as binary glTF."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += b"" if binary is None else struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", version, 12 + len(chunks)) + chunks


def volume(mesh: Mesh) -> float:
    """Return the volume inside faces that are wound outwards."""
    return float(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume)

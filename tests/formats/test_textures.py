"""Textures that cannot be decoded are listed with the reason; alpha counts only where the mesh file says so."""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.formats.mesh_file import parse_mesh
from pipeline.kernels.geometry.mesh import Mesh

OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 2/2 4/3\n"
MTL = "newmtl a\nKd 0 1 0\nmap_Kd a.png\nnewmtl b\nmap_Kd b.png\n"
PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
)
NOISE = Image.fromarray(np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8))
RED = Image.new("RGB", (4, 4), (200, 30, 30))


def encoded(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def cut(image: Image.Image, kind: str) -> bytes:
    return encoded(image, kind)[: 3 * len(encoded(image, kind)) // 4]


def png_of_16_bits(kind: int, *levels: int) -> bytes:
    """Write one pixel as PNG of 16 bits per channel, of a colour type: 4 is grey with alpha, 6 colours with alpha."""
    parts = {
        b"IHDR": struct.pack(">IIBBBBB", 1, 1, 16, kind, 0, 0, 0),
        b"IDAT": zlib.compress(b"\0" + struct.pack(f">{len(levels)}H", *levels)),
    }
    chunks = (
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in (*parts.items(), (b"IEND", b""))
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def texture_of(mesh: Mesh, material: str) -> np.ndarray | None:
    """Return the texture of the face of material a or b, which lies in the plane of z = 0 or not."""
    flat = (mesh.triangles[:, :, 2] == 0).all(axis=1)
    index = mesh.look.material_texture[mesh.look.face_material[flat == (material == "a")]][0]
    return None if index < 0 else mesh.look.textures[index]


def painted(folder: Path, content: bytes, *, mtl: str = MTL) -> Mesh:
    """Read a mesh of two materials, of which the first has a texture of some content, and the second a red one."""
    (folder / "a.obj").write_text(OBJ)
    (folder / "a.mtl").write_text(mtl)
    (folder / "a.png").write_bytes(content)
    RED.save(folder / "b.png")
    return parse_mesh(folder / "a.obj", folder)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is an empty file"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:5\nsize 5\n", "is a Git LFS pointer; run `git lfs pull`"),
        (b"<!DOCTYPE html><html></html>", "is a web page (HTML); download the file itself"),
        (cut(NOISE, "PNG"), "cannot be decoded: image file is truncated"),
        (cut(NOISE, "JPEG"), "cannot be decoded: image file is truncated"),
        (encoded(NOISE, "JPEG2000"), "is a JPEG 2000 image; convert it to PNG"),
        (b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(70), "is a KTX texture; convert it to PNG"),
        (b'<svg xmlns="http://www.w3.org/2000/svg"/>', "is an SVG drawing; convert it to PNG"),
        (b"hello", "is damaged, or no image that can be read; convert it to PNG"),
        (encoded(Image.new("F", (4, 4), 0.5), "TIFF"), "cannot be decoded: it has 32 bits per pixel; save it with 8 per colour"),
    ],
)
def test_texture_that_cannot_be_read_is_listed_and_costs_nothing_else(tmp_path: Path, content: bytes, reason: str) -> None:
    mesh = painted(tmp_path, content)
    (line,) = mesh.unread
    assert line.startswith(f"a.png {reason}")
    assert texture_of(mesh, "a") is None
    assert [0, 255, 0, 255] in mesh.look.base_color.tolist()  # as its material states
    assert texture_of(mesh, "b")[0, 0].tolist() == [200, 30, 30, 255]


@pytest.mark.parametrize("kind", ["JPEG", "BMP", "GIF", "TGA", "TIFF", "WEBP", "DDS", "PPM", "PCX"])
def test_texture_is_read_whatever_its_suffix_says(tmp_path: Path, kind: str) -> None:
    mesh = painted(tmp_path, encoded(RED, kind))
    assert mesh.unread == ()
    np.testing.assert_allclose(texture_of(mesh, "a")[0, 0], [200, 30, 30, 255], atol=3)


@pytest.mark.parametrize(("content", "count"), [(encoded(RED), 0), (cut(NOISE, "PNG"), 1), (b"", 1), (encoded(NOISE, "JPEG2000"), 1)])
def test_texture_of_a_ply_is_opaque_or_listed(tmp_path: Path, content: bytes, count: int) -> None:
    (tmp_path / "a.ply").write_text(PLY)
    (tmp_path / "a.png").write_bytes(content)
    mesh = parse_mesh(tmp_path / "a.ply", tmp_path)
    assert (len(mesh.unread), len(mesh.look.textures)) == (count, 1 - count)
    if not count:
        Image.new("RGBA", (4, 4), (200, 30, 30, 0)).save(tmp_path / "a.png")
        assert parse_mesh(tmp_path / "a.ply", tmp_path).look.textures[0][0, 0].tolist() == [200, 30, 30, 255]


def palette(**options: object) -> bytes:
    image = Image.new("P", (4, 4), 1)
    image.putpalette([0, 0, 0, 200, 30, 30])
    return encoded(image, **options)


@pytest.mark.parametrize(
    ("content", "color"),
    [
        (encoded(Image.new("RGBA", (4, 4), (200, 30, 30, 128))), [200, 30, 30, 128]),
        (encoded(RED, transparency=(200, 30, 30)), [200, 30, 30, 0]),
        (palette(), [200, 30, 30, 255]),
        (palette(transparency=1), [200, 30, 30, 0]),
        (encoded(Image.new("LA", (4, 4), (90, 128))), [90, 90, 90, 128]),
        (encoded(Image.new("L", (4, 4), 90), transparency=90), [90, 90, 90, 0]),
        (encoded(Image.fromarray(np.full((4, 4), 40_000, np.uint16))), [156, 156, 156, 255]),
        (png_of_16_bits(4, 40_000, 0), [156, 156, 156, 0]),
        (png_of_16_bits(6, 40_000, 0, 65535, 32_768), [156, 0, 255, 128]),
        (b"P5 1 1 65535\n" + struct.pack(">H", 40_000), [156, 156, 156, 255]),
    ],
)
def test_alpha_of_an_objs_texture_counts_only_if_map_d_names_it(tmp_path: Path, content: bytes, color: list[int]) -> None:
    assert texture_of(painted(tmp_path, content), "a")[0, 0].tolist() == [*color[:3], 255]
    mesh = painted(tmp_path, content, mtl=MTL.replace("newmtl b", "map_d -imfchan m a.png\nnewmtl b"))
    assert texture_of(mesh, "a")[0, 0].tolist() == color
    assert mesh.unread == ()


def test_texture_that_two_materials_use_keeps_its_alpha_for_the_one_that_says_so(tmp_path: Path) -> None:
    content = encoded(Image.new("RGBA", (4, 4), (200, 30, 30, 0)))
    mesh = painted(tmp_path, content, mtl="newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd a.png\nmap_d a.png\n")
    assert [texture_of(mesh, name)[0, 0, 3] for name in "ab"] == [255, 0]

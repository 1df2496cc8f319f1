"""Mesh files of every format with their materials, and files that hold no mesh."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import EpsImagePlugin, Image

from pipeline.dataset.mesh_rows import mesh_row, read_mesh
from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import _join, parse_mesh
from pipeline.formats.mesh_reader import load_mesh
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import clean_mesh

POINTS = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n"
BOX = trimesh.creation.box((1, 2, 3))


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb", "gltf"])
def test_every_format_gives_the_same_triangles(tmp_path, suffix):
    path = tmp_path / f"box.{suffix}"
    if suffix == "gltf":
        for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(BOX)).items():
            (tmp_path / ("box.gltf" if name.endswith(".gltf") else name)).write_bytes(content)
    else:
        BOX.export(path)
    mesh = load_mesh(path)
    np.testing.assert_allclose(np.sort(mesh.triangles, axis=None), np.sort(BOX.triangles, axis=None), atol=1e-6)


def textured_quad(folder: Path) -> Path:
    image = np.zeros((2, 2, 3), np.uint8)
    image[0, 1] = 255, 0, 0  # right of the top row
    Image.fromarray(image).save(folder / "paint.png")
    (folder / "quad.mtl").write_text("newmtl paint\nKd 1 1 1\nmap_Kd paint.png\nnewmtl plain\nKd 0 0 1\n")
    (folder / "quad.obj").write_text(
        "mtllib quad.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        "usemtl paint\nf 1/1 2/2 3/3\nusemtl plain\nf 1/1 3/3 4/4\n"
    )
    return folder / "quad.obj"


def test_materials_and_textures_are_read_per_face(tmp_path):
    look = load_mesh(textured_quad(tmp_path)).look
    texture_of_face = look.material_texture[look.face_material]
    assert sorted(texture_of_face >= 0) == [False, True]
    plain = int(np.flatnonzero(texture_of_face < 0)[0])
    np.testing.assert_array_equal(look.base_color[look.face_material[plain]], [0, 0, 255, 255])
    (texture,) = look.textures
    np.testing.assert_array_equal(texture[0, 1], [255, 0, 0, 255])
    assert set(map(tuple, look.uv.tolist())) >= {(0, 0), (1, 0), (1, 1)}


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_vertex_colours_stay_with_their_vertices(tmp_path, suffix):
    """Vertex colours also survive cleaning, a row of `surfaces`, and joining a part without colours. glTF states linear light."""
    box = BOX.copy()
    colors = np.array([[255 * (x > 0), 255 * (y > 0), 255 * (z > 0), 255] for x, y, z in BOX.vertices], np.uint8)
    colors[0, :3] = 128
    box.visual.vertex_colors = colors
    box.export(tmp_path / f"box{suffix}")
    mesh = load_mesh(tmp_path / f"box{suffix}")
    mesh = read_mesh(mesh_row(clean_mesh(mesh, 100)[0]))
    expected = colors.copy()
    expected[0, :3] = 188 if suffix == ".glb" else 128
    nearest = np.linalg.norm(mesh.vertices[:, None] - BOX.vertices, axis=2).argmin(axis=1)
    np.testing.assert_allclose(mesh.look.vertex_color.astype(int), expected[nearest], atol=1)
    assert mesh.look.base_color.tolist() == [[255, 255, 255, 255]]
    joined = _join([mesh, Mesh.bare(BOX.vertices, BOX.faces)])
    assert (joined.look.vertex_color[len(mesh.vertices) :] == 255).all()
    assert joined.look.vertex_color.shape == (len(mesh.vertices) + 8, 4)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("empty.obj", b"", "empty.obj is an empty file"),
        ("text.obj", b"Dear reader,\nthis is a letter.\n", "text.obj: it holds no triangle mesh|text.obj cannot be read as OBJ"),
        ("points.ply", POINTS, "no triangle"),
        ("cut.stl", b"solid", "cut.stl"),
        ("noise.glb", bytes(range(256)), "cannot be read as GLB"),
        ("flat.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "flat.obj: a vertex has fewer than three numbers"),
        ("box.zip", b"PK", r"box.zip cannot be read; convert it to one of \.obj"),
        ("large.obj", b"#" * 1001, "has 1001 bytes; 1000 are the most"),
        ("entries.gltf", b"[" * 101, "101 entries in its JSON, 100 are the most"),
        ("gone.obj", None, r"gone\.obj cannot be read \(No such file or directory\)"),
    ],
)
def test_files_without_a_mesh_are_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes | None, reason: str
) -> None:
    monkeypatch.setattr("pipeline.formats.mesh_companions.MAX_BYTES", 1000)
    monkeypatch.setattr("pipeline.formats.gltf.MAX_ENTRIES", 100)
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match=reason):
        parse_mesh(tmp_path / name, tmp_path)


def test_pixels_of_textures_are_bounded_together_before_decoding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = textured_quad(tmp_path)
    (tmp_path / "quad.mtl").write_text("newmtl paint\nmap_Kd paint.png\nnewmtl plain\nmap_Kd other.png\n")
    Image.new("RGB", (6000, 6000)).save(tmp_path / "paint.png")
    Image.new("RGB", (6000, 6001)).save(tmp_path / "other.png")
    monkeypatch.setattr(Image.Image, "convert", lambda image, mode: Image.new(mode, (1, 1)))
    with pytest.raises(InvalidInput, match=r"quad.obj: it has 72006000 pixels of textures, 67108864 are the most"):
        parse_mesh(path, tmp_path)


def test_texture_that_needs_another_program_is_dropped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = textured_quad(tmp_path)
    (tmp_path / "paint.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n%%EOF\n")
    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", pytest.fail)
    assert parse_mesh(path, tmp_path).look.textures == ()


@pytest.mark.parametrize("suffix", ["obj", "off", "stl", "ply"])
def test_comments_and_names_that_are_not_utf8_are_read(tmp_path: Path, suffix: str) -> None:
    first = {"obj": "# Größe\n", "off": "OFF\n# Größe\n", "stl": "solid Größe\n", "ply": "ply\ncomment Größe\n"}[suffix]
    exported = BOX.export(file_type="stl_ascii" if suffix == "stl" else suffix)
    content = exported if isinstance(exported, bytes) else exported.encode()  # a PLY is binary
    path = tmp_path / f"box.{suffix}"
    path.write_bytes(first.encode("latin-1") + (content if suffix == "obj" else content.partition(b"\n")[2]))
    assert len(parse_mesh(path, tmp_path).faces) == len(BOX.faces)

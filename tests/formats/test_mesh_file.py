"""Mesh files of every format with their materials, and files that hold no mesh."""

import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import EpsImagePlugin, Image

from pipeline.dataset.mesh_rows import mesh_row, read_mesh
from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import _join, parse_mesh
from pipeline.formats.mesh_reader import load_mesh
from pipeline.formats.obj_lines import rewrite_lines
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


def test_missing_texture_leaves_the_base_colour(tmp_path):
    path = textured_quad(tmp_path)
    (tmp_path / "paint.png").unlink()
    assert load_mesh(path).look.textures == ()


def test_truncated_texture_is_dropped_and_the_shape_is_kept(tmp_path, rng):
    path, image_file = textured_quad(tmp_path), tmp_path / "paint.png"
    Image.fromarray(rng.integers(0, 255, (64, 64, 3), np.uint8)).save(image_file)
    image_file.write_bytes(image_file.read_bytes()[:1000])
    mesh = load_mesh(path)
    assert len(mesh.faces) == 2
    assert mesh.look.textures == ()


def test_gltf_base_colour_is_linear_light(tmp_path):
    quad = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    white = Image.new("RGB", (2, 2), (255, 255, 255))
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[128, 0, 0, 255], baseColorTexture=white)
    quad.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [0, 1]], material=material)
    quad.export(tmp_path / "red.glb")
    look = load_mesh(tmp_path / "red.glb").look
    np.testing.assert_array_equal(look.base_color[0], [188, 0, 0, 255])  # half the light is 188 of 255 in sRGB
    assert (look.textures[0] == 255).all()


def test_collada_diffuse_colour_is_srgb(tmp_path):
    box = BOX.copy()
    box.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(baseColorFactor=[128, 0, 51, 255]))
    box.export(tmp_path / "red.dae")
    np.testing.assert_array_equal(load_mesh(tmp_path / "red.dae").look.base_color[0], [128, 0, 51, 255])


def test_face_colours_become_materials(tmp_path):
    box = BOX.copy()
    box.visual.face_colors = np.repeat([[255, 0, 0, 255], [0, 255, 0, 255]], 6, axis=0)
    box.export(tmp_path / "box.ply")
    look = load_mesh(tmp_path / "box.ply").look
    np.testing.assert_array_equal(look.base_color[look.face_material], box.visual.face_colors)


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


def test_scene_is_joined_with_its_transforms(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(BOX, transform=trimesh.transformations.translation_matrix([10, 0, 0]))
    scene.add_geometry(BOX)
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb")
    assert len(mesh.faces) == 24
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(11)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("empty.obj", b"", "empty.obj is an empty file"),
        ("text.obj", b"Dear reader,\nthis is a letter.\n", "text.obj holds no triangle mesh|text.obj cannot be read as OBJ"),
        ("points.ply", POINTS, "no triangle"),
        ("cut.stl", b"solid", "cut.stl"),
        ("noise.glb", bytes(range(256)), "cannot be read as GLB"),
    ],
)
def test_files_without_a_mesh_are_refused_by_name(tmp_path, name, content, reason):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match=reason):
        load_mesh(tmp_path / name)


def test_part_without_faces_is_left_out(tmp_path):
    (tmp_path / "parts.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl one\nf 1 usemtl two\nf 1 2 3\n")
    assert load_mesh(tmp_path / "parts.obj").faces.shape == (1, 3)


def test_invalid_texture_coordinates_become_zero(tmp_path) -> None:
    (tmp_path / "odd.mtl").write_text("newmtl m\nmap_Kd odd.png\n")
    Image.new("RGB", (4, 4), (9, 9, 9)).save(tmp_path / "odd.png")
    uv = ["0.5 0.25", "nan 1", "1e39 0.5"]
    lines = ["mtllib odd.mtl", "usemtl m", "v 0 0 0", "v 1 0 0", "v 0 1 0", *(f"vt {pair}" for pair in uv), "f 1/1 2/2 3/3"]
    (tmp_path / "odd.obj").write_text("\n".join(lines))
    look = load_mesh(tmp_path / "odd.obj").look
    assert look.uv.tolist() == [[0.5, 0.25], [0, 1], [0, 0.5]]


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def gltf(folder: Path, **changes: object) -> Path:
    """Write a box as glTF, with some entries of its JSON changed."""
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(BOX)).items():
        (folder / name).write_bytes(content)
    path = folder / "model.gltf"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return path


def test_texture_of_several_materials_is_decoded_and_stored_once(tmp_path: Path) -> None:
    path = textured_quad(tmp_path)
    (tmp_path / "quad.mtl").write_text("newmtl paint\nmap_Kd paint.png\nnewmtl plain\nmap_Kd paint.png\n")
    look = load_mesh(path).look
    assert len(look.textures) == 1
    assert look.material_texture.tolist() == [0, 0]


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


def test_gltf_with_too_many_entries_is_refused_before_parsing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.formats.gltf.MAX_ENTRIES", 1000)
    with pytest.raises(InvalidInput, match="entries in its JSON, 1000 are the most"):
        parse_mesh(gltf(tmp_path, extras=[0] * 1001), tmp_path)


def test_only_mesh_formats_are_opened(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "box.zip", "w") as archive:
        archive.writestr("box.obj", TRIANGLE)
    with pytest.raises(InvalidInput, match=r"box.zip cannot be read; convert it to one of \.obj"):
        load_mesh(tmp_path / "box.zip")


def test_mesh_file_that_is_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.formats.mesh_companions.MAX_BYTES", 100)
    (tmp_path / "large.obj").write_bytes(b"#" * 101)
    with pytest.raises(InvalidInput, match="has 101 bytes, 100 are the most"):
        parse_mesh(tmp_path / "large.obj", tmp_path)


def test_vertices_of_two_columns_are_refused(tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(InvalidInput, match=r"flat.obj cannot be read as OBJ"):
        load_mesh(tmp_path / "flat.obj")


def test_reader_of_meshes_logs_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "odd.stl").write_text("solid a\nnormal x\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid a\n")
    parse_mesh(tmp_path / "odd.stl", tmp_path)
    assert not caplog.records


def test_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(InvalidInput, match=r"gone\.obj is not there"):
        load_mesh(tmp_path / "gone.obj")


@pytest.mark.parametrize("suffix", ["obj", "off", "stl", "ply"])
def test_comments_and_names_that_are_not_utf8_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)  # with it, trimesh guesses
    first = {"obj": "# Größe\n", "off": "OFF\n# Größe\n", "stl": "solid Größe\n", "ply": "ply\ncomment Größe\n"}[suffix]
    exported = BOX.export(file_type="stl_ascii" if suffix == "stl" else suffix)
    content = exported if isinstance(exported, bytes) else exported.encode()  # a PLY is binary
    path = tmp_path / f"box.{suffix}"
    path.write_bytes(first.encode("latin-1") + (content if suffix == "obj" else content.partition(b"\n")[2]))
    assert len(parse_mesh(path, tmp_path).faces) == len(BOX.faces)


def test_materials_that_are_not_utf8_keep_their_textures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)
    (tmp_path / "a.obj").write_bytes("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl grün\nf 1/1 2/1 3/1\n".encode("latin-1"))
    (tmp_path / "a.mtl").write_bytes("# Größe\nnewmtl grün\nmap_Kd grün.png\n".encode("latin-1"))
    Image.new("RGB", (2, 2), (9, 99, 9)).save(tmp_path / "grün.png")
    assert parse_mesh(tmp_path / "a.obj", tmp_path).look.textures[0][0, 0].tolist() == [9, 99, 9, 255]


@pytest.mark.parametrize("first", range(8))
@pytest.mark.parametrize("numbered", ["", "/1", "//1"])
def test_concave_polygon_is_not_filled(tmp_path: Path, first: int, numbered: str) -> None:
    """A U of 3 x 3 with a notch of 1 x 2, whose corners are named from any first one, before and after, by positive or negative numbers."""
    outline = np.roll([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], -first, axis=0)
    corners = "".join(f"v {x} {y} {x + y}\n" for x, y in outline)
    for numbers in (range(1, 9), range(-8, 0)):
        first_part, second_part = (" ".join(f"{number}{numbered}" for number in part) for part in (numbers[:4], numbers[4:]))
        path = tmp_path / "u.obj"
        path.write_text(f"vt 0 0\nvn 0 0 1\n{corners}f {first_part} \\\n{second_part}\nv 9 9 9\n")
        mesh = load_mesh(path)
        assert len(mesh.faces) == 6
        sides = np.diff(mesh.triangles, axis=1)
        assert np.abs(np.cross(sides[:, 0], sides[:, 1])[:, 2]).sum() / 2 == pytest.approx(7)  # as seen from above


def test_relative_numbers_count_from_their_place_in_the_file(tmp_path: Path) -> None:
    corners = ["v 0 0 0\nv 1 0 0\nv 0 1 0\n", "v 5 0 0\nv 6 0 0\nv 5 1 0\n"]
    (tmp_path / "two.obj").write_text("f -3 -2 -1\n".join([*corners, ""]))
    assert load_mesh(tmp_path / "two.obj").triangles[:, 0].tolist() == [[0, 0, 0], [5, 0, 0]]
    (tmp_path / "two.obj").write_text(f"{corners[0]}f -1 -2 -4\n")
    with pytest.raises(InvalidInput, match="a face counts back to vertex 0, the first one is 1; the file is damaged"):
        load_mesh(tmp_path / "two.obj")


def test_polygons_that_are_convex_or_damaged_stay_as_they_are() -> None:
    square = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    for polygon in (b"f 1 2 3 4\n", b"f 1 2 3 9\n", b"f 0 1 2 3\n", b"f 1 1 1 1\n", b"f - / 2 3\n"):
        assert rewrite_lines(square + polygon) == square + polygon
    assert rewrite_lines(b"v 0 0 x\nf 1 1 1 1\n") == b"v 0 0 x\nf 1 1 1 1\n"


@pytest.mark.parametrize(
    ("first", "second"), [("  v", "\tf"), ("v\t", "f"), ("v", "f\t"), (" \tv ", " f ")], ids=["indented", "tab", "tab of face", "blanks"]
)
@pytest.mark.parametrize("comment", ["", "  # of the roof"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_lines_with_other_blanks_and_comments_are_read(tmp_path: Path, first: str, second: str, comment: str, end: str) -> None:
    lines = ["# a square", f"{first} 0 0 0", f"{first} 1 0 0{comment}", "v 1 1 0", "v 0 1 0", f"{second} 1 2 3{comment}", "f 1 3 4"]
    (tmp_path / "square.obj").write_text(end.join([*lines, ""]), newline="")
    mesh = load_mesh(tmp_path / "square.obj")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    "lines", ["mtllib a.mtl\nmtllib b.mtl", "mtllib a.mtl b.mtl", "# mtllib none.mtl\n mtllib b.mtl  a.mtl", "mtllib a b.mtl"]
)
def test_all_material_libraries_of_an_obj_are_read(tmp_path: Path, lines: str) -> None:
    one, two = "newmtl one\nKd 1 0 0\n", "newmtl two\nKd 0 0 1\n"
    for name, content in {"a.mtl": one, "b.mtl": two, "a b.mtl": one + two}.items():
        (tmp_path / name).write_text(content)
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl one\nf 1 2 3\nusemtl two\nf 1 3 4\n"
    (tmp_path / "square.obj").write_text(f"{lines}\n{square}")
    assert sorted(load_mesh(tmp_path / "square.obj").look.base_color[:, :3].tolist()) == [[0, 0, 255], [255, 0, 0]]


def test_grey_of_sixteen_bits_is_scaled(tmp_path: Path) -> None:
    path = textured_quad(tmp_path)
    Image.fromarray(np.full((2, 2), 40_000, np.uint16)).save(tmp_path / "paint.png")
    assert load_mesh(path).look.textures[0][0, 0].tolist() == [156, 156, 156, 255]

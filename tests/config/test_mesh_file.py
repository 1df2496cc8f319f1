"""Mesh files of every format with their materials, and files that hold no mesh."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.config.mesh_file import load_mesh
from pipeline.errors import InvalidInput

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
    worn = look.material_texture[look.face_material]
    assert sorted(worn >= 0) == [False, True]
    plain = int(np.flatnonzero(worn < 0)[0])
    np.testing.assert_array_equal(look.base_color[look.face_material[plain]], [0, 0, 255, 255])
    (texture,) = look.textures
    np.testing.assert_array_equal(texture[0, 1], [255, 0, 0, 255])
    assert set(map(tuple, look.uv.tolist())) >= {(0, 0), (1, 0), (1, 1)}


def test_missing_texture_leaves_the_base_colour(tmp_path):
    path = textured_quad(tmp_path)
    (tmp_path / "paint.png").unlink()
    assert load_mesh(path).look.textures == ()


def test_truncated_texture_loses_the_look_and_keeps_the_shape(tmp_path, rng):
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


def test_face_colours_become_materials(tmp_path):
    box = BOX.copy()
    box.visual.face_colors = np.repeat([[255, 0, 0, 255], [0, 255, 0, 255]], 6, axis=0)
    box.export(tmp_path / "box.ply")
    look = load_mesh(tmp_path / "box.ply").look
    np.testing.assert_array_equal(look.base_color[look.face_material], box.visual.face_colors)


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


def test_invalid_texture_coordinates_become_zero(tmp_path) -> None:
    (tmp_path / "odd.mtl").write_text("newmtl m\nmap_Kd odd.png\n")
    Image.new("RGB", (4, 4), (9, 9, 9)).save(tmp_path / "odd.png")
    uv = ["0.5 0.25", "nan 1", "1e39 0.5"]
    lines = ["mtllib odd.mtl", "usemtl m", "v 0 0 0", "v 1 0 0", "v 0 1 0", *(f"vt {pair}" for pair in uv), "f 1/1 2/2 3/3"]
    (tmp_path / "odd.obj").write_text("\n".join(lines))
    look = load_mesh(tmp_path / "odd.obj").look
    assert look.uv.tolist() == [[0.5, 0.25], [0, 1], [0, 0.5]]


def test_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(InvalidInput, match=r"gone\.obj is not there"):
        load_mesh(tmp_path / "gone.obj")
